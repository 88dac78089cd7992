"""What every image shows at one place: found where the camera moves, and without depth then."""

import dataclasses

import numpy as np
import pytest

import vnav
from tests.lighting.lamp import LampLit
from tests.overlays.marked import BUMPER, Marked, Resting, Standing
from vnav.checking.capture_report import summary
from vnav.config import CaptureConfig, Config
from vnav.core.frame import Frame
from vnav.errors import CaptureError
from vnav.io.sources.capture import Capture
from vnav.io.sources.derived import DerivedCapture
from vnav.overlays.overlay import WIDTH_PX, overlay_of, without_overlay

LARGER = 3  # than the tiny capture


@pytest.fixture(scope="module")
def marked(capture: Capture) -> Marked:
    return Marked(capture)


def test_text_and_a_part_of_the_robot_are_found(marked: Marked) -> None:
    overlay = overlay_of(marked)
    assert overlay is not None
    assert overlay[marked.marks].mean() > 0.99  # where what is behind a letter is as bright
    assert overlay.mean() < 2 * marked.marks.mean() + 0.1


@pytest.mark.parametrize("made", [DerivedCapture, LampLit])
def test_a_scene_is_no_overlay(capture: Capture, made: type[DerivedCapture]) -> None:
    assert overlay_of(made(capture)) is None


def test_what_a_resting_camera_shows_is_no_overlay(capture: Capture, marked: Marked) -> None:
    assert overlay_of(Resting(capture, 1)) is None
    assert overlay_of(Resting(marked, 1)) is None  # nothing tells them apart


def test_a_scene_that_a_trembling_camera_stands_before_is_no_overlay(capture: Capture) -> None:
    assert overlay_of(Standing(capture)) is None


def test_a_scene_before_which_the_camera_rested_for_half_of_the_time_is_none(
    capture: Capture, marked: Marked
) -> None:
    assert overlay_of(Resting(capture, len(capture) // 2)) is None
    overlay = overlay_of(Resting(marked, len(capture) // 2))
    assert overlay is not None
    assert overlay[marked.marks].mean() > 0.95
    assert overlay.mean() < 2 * marked.marks.mean() + 0.1


@pytest.mark.filterwarnings("error")
def test_black_images_show_no_overlay(capture: Capture) -> None:
    class Black(DerivedCapture):
        def read(self, index: int) -> Frame:
            frame = super().read(index)
            return dataclasses.replace(frame, color=np.zeros_like(frame.color))

    assert overlay_of(Black(capture)) is None


def test_frames_that_cannot_be_read_are_left_out(marked: Marked) -> None:
    class Damaged(DerivedCapture):
        def read(self, index: int) -> Frame:
            if index < 10:
                raise CaptureError("expected an image, found none")
            return super().read(index)

    overlay = overlay_of(Damaged(marked))
    assert overlay is not None
    assert overlay[marked.marks].mean() > 0.95


def test_depth_is_left_out_there_and_nowhere_else(marked: Marked) -> None:
    overlay, (seen, share) = overlay_of(marked), without_overlay(marked)
    assert overlay is not None
    assert share == pytest.approx(overlay.mean())
    before, after = marked.read(7), seen.read(7)
    assert not after.depth_m[overlay].any()
    np.testing.assert_array_equal(after.depth_m[~overlay], before.depth_m[~overlay])
    np.testing.assert_array_equal(after.color, before.color)
    assert seen.fingerprint() == marked.fingerprint()


def test_a_large_image_loses_depth_in_the_same_places(marked: Marked) -> None:
    class Large(DerivedCapture):
        def read(self, index: int) -> Frame:
            frame = super().read(index)
            color, depth_m = (
                np.repeat(np.repeat(image, LARGER, 0), LARGER, 1)
                for image in (frame.color, frame.depth_m)
            )
            camera = dataclasses.replace(
                frame.intrinsics, width=color.shape[1], height=color.shape[0]
            )
            return dataclasses.replace(frame, color=color, depth_m=depth_m, intrinsics=camera)

    small, large = (without_overlay(capture)[0].read(7) for capture in (marked, Large(marked)))
    assert large.color.shape[1] > WIDTH_PX
    kept = large.depth_m[::LARGER, ::LARGER]
    assert not kept[marked.marks & (marked.read(7).depth_m > 0)].any()
    assert ((kept > 0) != (small.depth_m > 0)).mean() < 0.05  # at its rim


def test_a_capture_without_overlay_or_depth_is_left_as_it_is(capture: Capture) -> None:
    class Blind(Marked):
        has_depth = False

    for whole in (capture, Blind(capture)):
        assert without_overlay(whole) == (whole, 0.0)


def test_check_tells_of_it(marked: Marked, capture: Capture) -> None:
    report = vnav.check(marked)
    (line,) = (line for line in summary(report) if line.startswith("overlay"))
    assert line == (
        f"overlay  {report.overlay:.1%} of the image shows the same in all views, as burnt-in text"
        " does: depth there will be left out"
    )
    assert report.overlay is not None
    assert report.overlay > 1 - BUMPER
    assert not any("overlay" in line for line in summary(vnav.check(capture)))
    config = Config(capture=CaptureConfig(overlay="off"))
    assert vnav.check(marked, config=config).overlay is None
