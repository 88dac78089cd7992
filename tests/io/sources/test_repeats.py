"""Which images of a capture come twice."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from vnav.config import CaptureConfig
from vnav.io.sources.capture import FileBacked
from vnav.io.sources.open_capture import open_capture
from vnav.io.sources.repeats import Repeats, repeats, stale_frames
from vnav.io.sources.subset import Subset

FRAMES = 60


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


def stale(folder: Path) -> dict[int, str]:
    return stale_frames(open_capture(folder, CaptureConfig()))


def test_images_that_come_once_are_none(folder: Path) -> None:
    assert found(folder) == Repeats(FRAMES)
    assert not stale(folder)


def test_images_are_told_apart_by_what_comes_twice(folder: Path) -> None:
    repeat(folder, "rgb", [5, 9, 20])
    repeat(folder, "depth", [9, 30])
    assert found(folder) == Repeats(FRAMES, color=(5, 20), depth=(30,), both=(9,))


def test_a_change_of_one_pixel_makes_an_image_another(folder: Path) -> None:
    repeat(folder, "rgb", [5])
    file = sorted((folder / "rgb").iterdir())[5]
    image = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
    image[7, 7, 0] ^= 1
    cv2.imwrite(str(file), image)
    assert found(folder) == Repeats(FRAMES)


def test_depth_that_sees_nothing_comes_never_twice(folder: Path) -> None:
    files = sorted((folder / "depth").iterdir())
    nothing = np.zeros_like(cv2.imread(str(files[0]), cv2.IMREAD_UNCHANGED))
    for file in files[10:30]:
        cv2.imwrite(str(file), nothing)
    assert found(folder) == Repeats(FRAMES)


@pytest.mark.parametrize(("kind", "name"), [("rgb", "colour"), ("depth", "depth")])
def test_of_a_slow_camera_every_frame_that_has_its_image_once_more_is_stale(
    folder: Path, kind: str, name: str
) -> None:
    rows = [row for row in range(FRAMES) if row % 3]
    repeat(folder, kind, rows)
    reasons = stale(folder)
    assert sorted(reasons) == rows
    assert set(reasons.values()) == {
        f"its {name} image is that of the frame before; record colour and depth at one rate"
    }


@pytest.mark.parametrize(("every", "is_slow"), [(2, True), (6, True), (12, False)])
def test_a_camera_that_slips_now_and_then_is_not_slow(
    folder: Path, every: int, is_slow: bool
) -> None:
    repeat(folder, "rgb", list(range(1, FRAMES, every)))
    assert bool(stale(folder)) == is_slow


def test_a_recording_that_stalls_has_no_slow_camera(folder: Path) -> None:
    for kind in ("rgb", "depth"):
        repeat(folder, kind, list(range(1, FRAMES, 2)))
    assert found(folder).has_stalled
    assert not stale(folder)


def test_of_frames_that_are_no_files_nothing_is_known(folder: Path) -> None:
    repeat(folder, "rgb", list(range(1, FRAMES, 2)))
    capture = open_capture(folder, CaptureConfig())
    assert not stale_frames(Subset(capture, range(FRAMES)))
