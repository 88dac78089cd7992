"""A rendered capture whose depth is paired with the colour of other frames."""

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest

from vnav.checking.capture_report import inspect, summary
from vnav.checking.depth_lag import REACH, DepthLag, depth_lag, lagging_profiles, rows_to_compare
from vnav.config import CaptureConfig
from vnav.core.frame import Frame
from vnav.io.sources.capture import Capture
from vnav.io.sources.derived import DerivedCapture
from vnav.io.sources.open_capture import open_capture


class Late(DerivedCapture):
    """Frames with the depth of some frames before; of those after where ``by`` is below 0."""

    def __init__(self, capture: Capture, by: int) -> None:
        super().__init__(capture)
        self._by, self._last = by, len(capture) - 1

    def read(self, index: int) -> Frame:
        earlier = super().read(min(max(index - self._by, 0), self._last))
        return dataclasses.replace(super().read(index), depth_m=earlier.depth_m)


def found(capture: Capture) -> DepthLag | None:
    step_s = float(np.median(np.diff(capture.stamps_s)))
    rows = rows_to_compare(len(capture))
    profiles = (lagging_profiles(capture, row) for row in rows)
    return depth_lag([each for each in profiles if each], step_s)


@pytest.mark.parametrize("by", [-3, -1, 1, 4])
def test_depth_of_other_frames_is_found(capture: Capture, by: int) -> None:
    lag = found(Late(capture, by))
    assert lag is not None
    assert lag.frames == by
    assert lag.time_s == pytest.approx(by * np.median(np.diff(capture.stamps_s)))


def test_depth_of_the_same_moment_has_no_lag(capture: Capture) -> None:
    assert found(capture) is None


def test_a_capture_that_stands_still_tells_of_no_lag(capture: Capture) -> None:
    class Still(DerivedCapture):
        def read(self, index: int) -> Frame:
            return super().read(0)

    assert found(Still(capture)) is None


def test_frames_of_two_sizes_are_not_held_against_each_other(capture: Capture) -> None:
    """The larger part tells; a place where sizes change does not."""

    class HalfAsLarge(Late):
        def read(self, index: int) -> Frame:
            frame = super().read(index)
            if index < len(self) - 2 * REACH:
                return frame
            width, height = (side // 2 for side in frame.intrinsics.size)
            color, depth_m = frame.color[::2, ::2], frame.depth_m[::2, ::2]
            smaller = frame.intrinsics.scaled(width, height)
            return dataclasses.replace(frame, color=color, depth_m=depth_m, intrinsics=smaller)

    lag = found(HalfAsLarge(capture, 2))
    assert lag is not None
    assert lag.frames == 2


def test_a_short_capture_tells_of_no_lag() -> None:
    assert rows_to_compare(2 * REACH) == []
    assert rows_to_compare(2 * REACH + 1) == [REACH]
    assert depth_lag([], 0.1) is None


def test_check_tells_of_late_depth(capture: Capture) -> None:
    report = inspect(Late(capture, 3))
    (warning,) = (text for text in report.warnings if "belongs with" in text)
    step_s = report.timing.median_step_s
    assert f"the colour of 3 frames before it, by {3 * step_s:.3f} s" in warning
    assert f"Add -{3 * step_s:.3f} s to depth's time stamps" in warning
    assert any("on the colour of 3 frames before it" in line for line in summary(report))


def test_check_does_not_ask_where_depth_lies_on_its_own_colour(capture: Capture) -> None:
    report = inspect(capture)
    assert report.look is not None
    assert report.look.depth_lag is None
    assert not any("belongs with" in text for text in report.warnings)


def test_check_tells_by_how_much_the_stamps_of_depth_are_late(
    tiny_capture: Path, capture: Capture, tmp_path: Path
) -> None:
    folder = tmp_path / "late"
    shutil.copytree(tiny_capture, folder)
    text = (folder / "depth.txt").read_text()
    lines = [line.split() for line in text.splitlines() if line[0] != "#"]
    late_s = 3 * float(np.diff(capture.stamps_s)[0]) + 0.01  # the pairs found are 10 ms apart
    late = [f"{float(stamp) + late_s:.6f} {name}\n" for stamp, name in lines]
    (folder / "depth.txt").write_text("".join(late))

    report = inspect(open_capture(folder, CaptureConfig()))

    (warning,) = (text for text in report.warnings if "belongs with" in text)
    told_s = float(warning.split(" Add ")[1].split()[0])
    assert told_s == pytest.approx(-late_s, abs=0.005)  # its own depth is 4 ms late
