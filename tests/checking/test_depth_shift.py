"""A rendered capture whose depth is moved by known pixels."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest

import vnav
from vnav.checking.capture_report import inspect, summary
from vnav.checking.depth_shift import DepthShift, depth_shift, edge_profiles
from vnav.config import CaptureConfig
from vnav.core.frame import Frame
from vnav.io.sources.open_capture import open_capture


@pytest.fixture(scope="module")
def some(tiny_capture: Path) -> list[Frame]:
    """Every third frame of the room."""
    capture = open_capture(tiny_capture, CaptureConfig())
    return [capture.read(k) for k in range(0, len(capture), 3)]


def moved(frame: Frame, right: int, down: int) -> Frame:
    """The frame, its depth moved by whole pixels."""
    by = np.array([[1, 0, right], [0, 1, down]], float)
    depth_m = cv2.warpAffine(
        np.asarray(frame.depth_m), by, frame.intrinsics.size, flags=cv2.INTER_NEAREST
    )
    return dataclasses.replace(frame, depth_m=depth_m)


def found(frames: Sequence[Frame]) -> DepthShift:
    shift = depth_shift([edge_profiles(frame) for frame in frames])
    assert shift is not None
    return shift


def require(shift: DepthShift, px: tuple[float, float]) -> None:
    """Within three standard deviations, which are no more than a pixel."""
    off = np.abs(np.subtract(shift.px, px))
    assert (off < 3 * np.array(shift.sigma_px)).all()
    assert max(shift.sigma_px) < 1


@pytest.mark.parametrize("px", [(0, 0), (5, 0), (0, -4), (-3, 3)])
def test_a_known_shift_is_found(some: list[Frame], px: tuple[int, int]) -> None:
    require(found([moved(frame, *px) for frame in some]), px)


def test_things_that_are_wider_in_depth_are_not_shifted(some: list[Frame]) -> None:
    def widened(frame: Frame) -> Frame:
        depth_m = np.where(frame.depth_m > 0, frame.depth_m, 9)
        depth_m = cv2.erode(depth_m, np.ones((3, 3)))
        return dataclasses.replace(frame, depth_m=np.where(depth_m < 9, depth_m, 0))

    require(found([widened(frame) for frame in some]), (0, 0))


def test_colour_of_other_frames_tells_nothing(some: list[Frame]) -> None:
    mixed = [
        dataclasses.replace(frame, color=other.color)
        for frame, other in zip(some, some[7:] + some[:7], strict=True)
    ]
    assert depth_shift([edge_profiles(frame) for frame in mixed]) is None


def test_few_edges_tell_nothing(some: list[Frame]) -> None:
    assert depth_shift([edge_profiles(some[0])]) is None
    assert depth_shift([]) is None


@pytest.mark.parametrize(("right", "warned"), [(0, False), (2, False), (-6, True)])
def test_depth_beside_colour_is_warned_of_from_a_hundredth_of_the_width(
    some: list[Frame], right: int, warned: bool
) -> None:
    frames = [moved(frame, right, 0) for frame in some]
    capture = vnav.frames(
        [frame.color for frame in frames],
        [frame.depth_m for frame in frames],
        vnav.Camera(frames[0].intrinsics, 1000.0),
    )
    report = inspect(capture)
    assert any("edges of depth lie" in warning for warning in report.warnings) == warned
    (line,) = [line for line in summary(report) if line.startswith("edges")]
    assert ("px left" if right < 0 else "px right") in line or right == 0
    assert line.endswith("of colour")
