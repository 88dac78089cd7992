"""What every image shows at one place: found where the camera moves, and without depth then."""

from pathlib import Path

import numpy as np
import pytest

import vnav
from tests.lighting.lamp import LampLit
from tests.overlays.marked import BUMPER, Marked, Resting
from vnav.checking.capture_report import summary
from vnav.config import CaptureConfig, Config
from vnav.core.frame import Frame
from vnav.errors import CaptureError
from vnav.io.sources.capture import Capture
from vnav.io.sources.derived import DerivedCapture
from vnav.io.sources.open_capture import open_capture
from vnav.overlays.overlay import WithoutOverlay, overlay_of, without_overlay


@pytest.fixture(scope="module")
def capture(tiny_capture: Path) -> Capture:
    return open_capture(tiny_capture, CaptureConfig())


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


def test_a_scene_before_which_the_camera_rested_for_half_of_the_time_is_none(
    capture: Capture, marked: Marked
) -> None:
    assert overlay_of(Resting(capture, len(capture) // 2)) is None
    overlay = overlay_of(Resting(marked, len(capture) // 2))
    assert overlay is not None
    assert overlay[marked.marks].mean() > 0.95
    assert overlay.mean() < 2 * marked.marks.mean() + 0.1


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
    seen, share = without_overlay(marked)
    assert isinstance(seen, WithoutOverlay)
    assert share == pytest.approx(seen.overlay.mean())
    before, after = marked.read(7), seen.read(7)
    assert not after.depth_m[seen.overlay].any()
    np.testing.assert_array_equal(after.depth_m[~seen.overlay], before.depth_m[~seen.overlay])
    np.testing.assert_array_equal(after.color, before.color)
    assert seen.fingerprint() == marked.fingerprint()


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
