"""Which images of a capture come twice."""

import shutil
from pathlib import Path

import pytest

from vnav.config import CaptureConfig
from vnav.io.sources.capture import FileBacked
from vnav.io.sources.open_capture import open_capture
from vnav.io.sources.repeats import Repeats, has_slow_camera, repeats
from vnav.io.sources.subset import Subset


@pytest.fixture
def folder(tiny_capture: Path, tmp_path: Path) -> Path:
    shutil.copytree(tiny_capture, tmp_path / "capture")
    return tmp_path / "capture"


def repeat(folder: Path, kind: str, rows: list[int]) -> None:
    """Let frames have the image of the frame before."""
    files = sorted((folder / kind).iterdir())
    for row in rows:
        files[row].write_bytes(files[row - 1].read_bytes())


def found(folder: Path) -> Repeats:
    capture = open_capture(folder, CaptureConfig())
    assert isinstance(capture, FileBacked)
    return repeats(capture.files.pairs)


def test_images_that_come_once_are_none(folder: Path) -> None:
    assert found(folder) == Repeats()
    assert not has_slow_camera(open_capture(folder, CaptureConfig()))


def test_images_are_counted_by_what_comes_twice(folder: Path) -> None:
    repeat(folder, "rgb", [5, 9, 20])
    repeat(folder, "depth", [9, 30])
    assert found(folder) == Repeats(color=2, depth=1, both=1)


@pytest.mark.parametrize(("every", "is_slow"), [(2, True), (6, True), (12, False)])
def test_a_camera_that_slips_now_and_then_is_not_slow(
    folder: Path, every: int, is_slow: bool
) -> None:
    repeat(folder, "rgb", list(range(1, 60, every)))
    assert has_slow_camera(open_capture(folder, CaptureConfig())) == is_slow


def test_a_recording_that_stalls_has_no_slow_camera(folder: Path) -> None:
    for kind in ("rgb", "depth"):
        repeat(folder, kind, list(range(1, 60, 2)))
    assert not has_slow_camera(open_capture(folder, CaptureConfig()))


def test_of_frames_that_are_no_files_nothing_is_known(folder: Path) -> None:
    repeat(folder, "rgb", list(range(1, 60, 2)))
    capture = open_capture(folder, CaptureConfig())
    assert not has_slow_camera(Subset(capture, range(60)))
