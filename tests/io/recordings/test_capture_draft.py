"""A capture folder is written whole or not at all."""

from pathlib import Path

import numpy as np
import pytest

from vnav.core.camera import Camera, Intrinsics
from vnav.core.trajectory import Trajectory
from vnav.errors import CaptureError
from vnav.io.recordings.capture_draft import CaptureDraft, new_capture

CAMERA = Camera(Intrinsics(8, 6, 9.0, 9.0, 3.5, 2.5), 1000.0)
NO_POSES = Trajectory(np.zeros(0), np.zeros((0, 4, 4)))


def test_the_lists_are_in_order_of_time_to_the_nanosecond(tmp_path: Path) -> None:
    with new_capture(tmp_path / "out") as draft:
        for stamp_ns in (1_700_000_000_000_000_001, 1_600_000_000_987_654_321):
            assert draft.add("rgb", stamp_ns, b"x", ".jpg") is None
        draft.finish(CAMERA, NO_POSES)
    assert (tmp_path / "out" / "rgb.txt").read_text().splitlines()[1:] == [
        "1600000000.987654321 rgb/1600000000.987654321.jpg",
        "1700000000.000000001 rgb/1700000000.000000001.jpg",
    ]
    assert not (tmp_path / "out" / "depth").exists()
    assert not (tmp_path / "out" / "depth.txt").exists()


def test_a_time_that_occurs_twice_and_one_before_1970_are_told(tmp_path: Path) -> None:
    draft = CaptureDraft(tmp_path)
    draft.add("rgb", 5, b"first", ".png")
    again, early = (draft.add("rgb", stamp_ns, b"x", ".png") for stamp_ns in (5, -1))
    assert again is not None
    assert "that of an image before" in again.reason
    assert early is not None
    assert "before 1970" in early.reason
    assert (tmp_path / "rgb" / "0.000000005.png").read_bytes() == b"first"


def test_a_folder_that_is_there_is_refused_and_left_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    with pytest.raises(CaptureError, match="there already"), new_capture(tmp_path / "out"):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_an_interruption_leaves_nothing(tmp_path: Path) -> None:
    def interrupted() -> None:
        with new_capture(tmp_path / "out") as draft:
            draft.add("rgb", 5, b"x", ".png")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert not list(tmp_path.iterdir())


def test_two_that_write_one_folder_do_not_touch_each_others_images(tmp_path: Path) -> None:
    def both() -> None:
        with new_capture(tmp_path / "out") as late:
            with new_capture(tmp_path / "out") as early:
                late.add("rgb", 5, b"late", ".png")
                early.add("rgb", 7, b"early", ".png")
                early.finish(CAMERA, NO_POSES)
            late.finish(CAMERA, NO_POSES)

    with pytest.raises(CaptureError, match="expected to write a capture to .*out, found"):
        both()
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    assert [path.read_bytes() for path in (tmp_path / "out" / "rgb").iterdir()] == [b"early"]


def test_what_a_kill_left_is_no_part_of_the_next_capture(tmp_path: Path) -> None:
    (tmp_path / ".out.draft" / "rgb").mkdir(parents=True)
    (tmp_path / ".out.draft" / "rgb" / "old.png").touch()
    with new_capture(tmp_path / "out") as draft:
        draft.finish(CAMERA, NO_POSES)
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["camera.toml"]


def test_a_full_disk_is_told_and_nothing_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    def written() -> None:
        with new_capture(tmp_path / "out") as draft:
            monkeypatch.setattr(Path, "write_bytes", full)
            draft.add("rgb", 5, b"x", ".png")

    with pytest.raises(CaptureError, match="No space left on device; make room"):
        written()
    assert not list(tmp_path.iterdir())
