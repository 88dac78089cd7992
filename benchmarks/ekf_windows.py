"""The filter on windows of captures, with depth and without, beside the figures of its source.

    python benchmarks/ekf_windows.py CAPTURE... [--ways ekf mono] [--people CAPTURE...] [--record]

Each CAPTURE has its truth. With depth, windows of 100 frames begin at 0, 100, ... 400, as those of
[000 section 4] are 100 frames: frames with a pose, and distances after SE(3) alignment, also as a
share of the way. Without depth, two windows of 300 frames: ATE after Sim(3) alignment. Walks past
people, such as benchmarks/people.py renders, are followed whole, without depth. Draws of one-point
RANSAC are those that were made; of five matches, those that the share of features that were matched
in the end would ask for. Exit code 1 where something wanted is missed.
"""

import argparse
import math
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from recording import Measurement, add_record_option, conclude

from vnav.config import CaptureConfig, load
from vnav.core.association import associate
from vnav.core.mapping import FrameTable, Odometry
from vnav.core.trajectory import Trajectory
from vnav.evaluation.score import Score, score
from vnav.features.description import undescribed
from vnav.io.sources.folder_capture import FolderCapture
from vnav.io.sources.open_capture import open_capture, read_truth
from vnav.registration.reduction import reduced
from vnav.threads import one_blas_thread, one_opencv_thread
from vnav.tracking.ekf.camera_filter import Followed
from vnav.tracking.ekf.one_point_ransac import draws_needed
from vnav.tracking.filter_odometry import FilterOdometry

WINDOWS = {"ekf": [(k, k + 100) for k in range(0, 500, 100)], "mono": [(0, 300), (250, 550)]}
ALIGN = {"ekf": "se3", "mono": "sim3"}
LEAST_SHARE = {"ekf": 1.0, "mono": 0.95}  # of the frames
MOST_PERCENT = {  # of the way; of other captures nothing is wanted
    "ekf": {"house": 1.0, "fr1_desk": 1.5},
    "mono": {"house": 3.0, "fr1_desk": 5.0},
}
MOST_PERCENT_PEOPLE = 7.0
MAX_DIFFERENCE_S = 0.02
SOURCE = (  # [000 section 4]: frames, mean cm, max cm, mean % of the way
    ("475 to 574", 1.1, 3.5, 0.5),
    ("1422 to 1521, a turn", 1.7, 5.1, 0.9),
    ("2043 to 2142, something large moves", 8.2, 16.4, 4.1),
    ("3689 to 3788", 2.0, 5.7, 1.0),
)


@dataclass(frozen=True)
class Window:
    """What the filter made of some frames, and the processor's time for a frame."""

    odometry: Odometry
    followed: Sequence[Followed]
    ms: float


@one_blas_thread
def follow(capture: FolderCapture, way: str, first: int, last: int) -> Window:
    """Frames from the first to before the last; reading and masks are not measured."""
    builder = FilterOdometry(load(way, ["masking.method=none"]))
    spent_s = 0.0
    with one_opencv_thread:
        for row, index in enumerate(range(first, last)):
            frame = capture.read(index)
            image = reduced(frame)
            started_s = time.process_time()
            builder.add(undescribed(row), frame, image)
            spent_s += time.process_time() - started_s
    rows = np.arange(last - first)
    odometry = builder.result(FrameTable(0 * rows, rows, capture.stamps_s[first:last]))
    return Window(odometry, list(builder.followed.values()), 1e3 * spent_s / len(rows))


def scored(window: Window, truth: Trajectory, align: str) -> Score:
    """The frames of the longest segment against the truth."""
    rows, odometry = window.odometry.longest_segment, window.odometry
    estimate = Trajectory(odometry.frames.stamp_s[rows], odometry.T_segment_camera[rows])
    return score(estimate, truth, MAX_DIFFERENCE_S, align=align)


def way_m(stamps_s: np.ndarray, truth: Trajectory) -> float:
    """Length of the true way through the frames of these times."""
    rows = associate(stamps_s, truth.stamps_s, MAX_DIFFERENCE_S)[:, 1]
    return Trajectory(truth.stamps_s[rows], truth.T_world_camera[rows]).length_m


def draws_of(window: Window) -> tuple[float, float]:
    """Median number a frame: those made, and those that five matches would ask for."""
    shares = [(len(one.low) + len(one.high)) / one.predicted for one in window.followed]
    five = [math.ceil(draws_needed(share, 5)) for share in shares]
    return float(np.median([one.draws for one in window.followed])), float(np.median(five))


def measured(
    capture: FolderCapture,
    truth: Trajectory,
    way: str,
    windows: Sequence[tuple[int, int]],
    most: float | None,
) -> Iterator[Measurement]:
    """Windows of a capture; ``most``: of the way in per cent, that the error may be."""
    for first, last in windows:
        window = follow(capture, way, first, min(last, len(capture)))
        found, frames = scored(window, truth, ALIGN[way]), len(window.odometry.frames)
        on, what = f"{capture.name}, {first} to {last - 1}", f"vnav, {way}"
        tracked = len(window.odometry.longest_segment)
        least = math.ceil(LEAST_SHARE[way] * frames)
        yield Measurement(on, what, "frames in one segment", tracked, "", f"at least {least}")
        error, length_m = found.ate.translation_m, way_m(window.odometry.frames.stamp_s, truth)
        off_m = error.mean if way == "ekf" else error.rmse
        quantity = "mean of the way" if way == "ekf" else "ATE of the way"
        yield Measurement(on, what, "mean", 100 * error.mean, "cm")
        yield Measurement(on, what, "max", 100 * error.max, "cm")
        wanted = None if most is None else f"at most {most:g}"
        yield Measurement(on, what, quantity, 100 * off_m / length_m, "%", wanted)
        one, five = draws_of(window)
        yield Measurement(on, what, "draws, one match", one)
        yield Measurement(on, what, "draws, five", five)
        yield Measurement(on, what, "processor time a frame", window.ms, "ms")


def of_the_source() -> Iterator[Measurement]:
    """What 000 reports of its robot, held against wheel odometry."""
    for frames, mean_cm, max_cm, percent in SOURCE:
        on, what = f"its corridor, {frames}", "[000 section 4]"
        yield Measurement(on, what, "mean", mean_cm, "cm")
        yield Measurement(on, what, "max", max_cm, "cm")
        yield Measurement(on, what, "mean of the way", percent, "%")


def opened(folder: Path) -> tuple[FolderCapture, Trajectory]:
    """A capture, and its truth."""
    return open_capture(folder, CaptureConfig()), read_truth(folder, CaptureConfig())


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("captures", type=Path, nargs="+", metavar="CAPTURE")
    parser.add_argument("--ways", nargs="+", choices=list(WINDOWS), default=list(WINDOWS))
    parser.add_argument("--people", type=Path, nargs="+", default=[], metavar="CAPTURE")
    add_record_option(parser)
    asked = parser.parse_args(arguments)
    found: list[Measurement] = []
    for folder in asked.captures:
        capture, truth = opened(folder)
        for way in asked.ways:
            most = MOST_PERCENT[way].get(capture.name)
            found += measured(capture, truth, way, WINDOWS[way], most)
    for folder in asked.people:
        capture, truth = opened(folder)
        found += measured(capture, truth, "mono", [(0, len(capture))], MOST_PERCENT_PEOPLE)
    return conclude("ekf_windows", [*found, *of_the_source()], asked, arguments)


if __name__ == "__main__":
    sys.exit(main())
