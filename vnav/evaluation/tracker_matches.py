"""What each tracker makes of one pair of frames, held against the truth: 001 section 6."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.config import Config
from vnav.config.registries import TRACKERS
from vnav.core import se3
from vnav.core.arrays import Array, Floats
from vnav.core.frame import Frame, Rejected
from vnav.core.mapping import FrameFeatures
from vnav.core.trajectory import Trajectory
from vnav.features.description import FrameDescriber
from vnav.features.matching import DescriptorMatcher
from vnav.registration.points3d import PointRegistration
from vnav.threads import one_blas_thread, one_opencv_thread
from vnav.tracking.followed_frames import strongest_in_cells
from vnav.tracking.trackers import tracker

RIGHT_PX = 3.0  # of the reprojection: 001 section 6
HIDDEN_SIGMAS, HIDDEN_SHARE = 3.0, 0.03  # by which depth before a point hides it
STEP_FRAMES = 2  # that show how the camera moves
BORDER_PX = 1.0  # of the image, where nothing is asked for


@dataclass(frozen=True)
class TrackerMatches:
    """Where one tracker finds points (N, 2) of a frame in another, NaN where it does not.

    ``true_px`` (N, 2): where the other sees them, NaN where it does not; None without truth.
    ``prepare_ms``, ``ms``: CPU time for the first frame, once, and for each of the others.
    """

    name: str
    px: Floats
    found_px: Floats
    true_px: Array | None
    prepare_ms: float
    ms: float

    @property
    def found(self) -> NDArray[np.bool_]:
        """Which points (N,) are found anywhere."""
        return np.isfinite(self.found_px[:, 0])

    @property
    def right(self) -> NDArray[np.bool_] | None:
        """Which (N,) are found where they are; None without truth."""
        if self.true_px is None:
            return None
        off_px = np.linalg.norm(self.found_px - self.true_px, axis=1)
        return np.asarray(off_px < RIGHT_PX, np.bool_)

    @property
    def precision(self) -> float | None:
        """Share of those found that are right; None without truth, or where none is found."""
        right, found = self.right, int(self.found.sum())
        return None if right is None or not found else float(right.sum() / found)

    @property
    def recall(self) -> float | None:
        """Share of those that the other frame sees that are right; None without truth."""
        right = self.right
        if right is None or self.true_px is None:
            return None
        return float(right.sum() / max(1, np.isfinite(self.true_px[:, 0]).sum()))

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        values = {"tracker": self.name, "points": len(self.px), "found": int(self.found.sum())}
        times = {"prepare_ms": round(self.prepare_ms, 1), "ms": round(self.ms, 1)}
        return values | {"precision": self.precision, "recall": self.recall} | times


@dataclass(frozen=True)
class TrackerPair:
    """Two frames, and what each tracker finds in the second of the first."""

    a: Frame
    b: Frame
    matches: tuple[TrackerMatches, ...]


@one_opencv_thread
@one_blas_thread
def match_by_all(
    a: Frame, b: Frame, before: Sequence[Frame], T_a_b: Array | None, config: Config
) -> TrackerPair:
    """What every tracker finds in b of the points that odometry would follow from a.

    They are predicted as in odometry: the step between the two frames ``before`` b goes on; without
    two the camera rests. ``T_a_b``: the true motion, if it is known.
    """
    describer = FrameDescriber(config)
    described = describer.describe(0, a)
    points = described[strongest_in_cells(described)]
    predicted_px = _seen(points, _predicted(a, before, describer, config), b)
    true_px = None if T_a_b is None else _visible(_seen(points, T_a_b, b), points, T_a_b, b, config)
    at, names = (predicted_px, true_px), sorted(TRACKERS)
    return TrackerPair(a, b, tuple(_matches(name, a, b, points, at, config) for name in names))


def true_motion(truth: Trajectory | None, a_s: float, b_s: float, largest_s: float) -> Array | None:
    """``T_a_b`` between two times, by the true poses nearest to them; None where one is missing."""
    if truth is None or not len(truth.stamps_s):
        return None
    off_s = np.abs(truth.stamps_s - np.array([[a_s], [b_s]]))
    if off_s.min(1).max() > largest_s:
        return None
    T_world_a, T_world_b = truth.T_world_camera[off_s.argmin(1)]
    return np.asarray(se3.inverse(T_world_a) @ T_world_b)


def _matches(
    name: str,
    a: Frame,
    b: Frame,
    points: FrameFeatures,
    at: tuple[Array, Array | None],
    config: Config,
) -> TrackerMatches:
    """By one tracker; a first run compiles what it needs."""
    config = replace(config, tracking=replace(config.tracking, method=name))
    px = points.features.keypoints_px
    for _ in range(2):
        started = time.process_time()
        made = tracker(a.color, points.features, config)
        made.find(a.color, px.astype(np.float64))
        prepared = time.process_time()
        found_px = made.find(b.color, at[0])
        ended = time.process_time()
    prepare_ms, ms = 1e3 * (prepared - started), 1e3 * (ended - prepared)
    return TrackerMatches(name, px, found_px, at[1], prepare_ms, ms)


def _predicted(
    a: Frame, before: Sequence[Frame], describer: FrameDescriber, config: Config
) -> Array:
    """``T_a_b`` if the step between the two frames before b is made once more; else a's pose."""
    if len(before) < STEP_FRAMES:
        return np.eye(4)
    matcher, rng = DescriptorMatcher(config.registration), np.random.default_rng(config.seed)
    of_a, poses = describer.describe(0, a), []
    for row, frame in enumerate(before, 1):
        pair = PointRegistration(a.intrinsics, frame.intrinsics, config.registration, matcher)
        estimate = pair.register(of_a, describer.describe(row, frame), rng)
        if isinstance(estimate, Rejected):
            return np.eye(4)
        poses.append(estimate.T_a_b)
    return np.asarray(poses[1] @ se3.inverse(poses[0]) @ poses[1])


def _seen(points: FrameFeatures, T_a_b: Array, b: Frame) -> Array:
    """Pixels (N, 2) of a's points in b, NaN beyond its image."""
    px = b.intrinsics.project(se3.transform(se3.inverse(T_a_b), points.points_camera))
    limit_px = np.array(b.intrinsics.size) - 1 - BORDER_PX
    inside = np.asarray((px >= BORDER_PX) & (px <= limit_px)).all(1, keepdims=True)
    return np.where(inside, px, np.nan)


def _visible(px: Array, points: FrameFeatures, T_a_b: Array, b: Frame, config: Config) -> Array:
    """The pixels (N, 2) of points that nothing hides, NaN for the others."""
    z = se3.transform(se3.inverse(T_a_b), points.points_camera)[:, 2]
    columns, rows = np.nan_to_num(px).round().astype(np.intp).T
    depth_m = b.depth_m[rows, columns]
    margin = HIDDEN_SIGMAS * config.registration.depth_sigma_per_m2 * z**2 + HIDDEN_SHARE * z
    hidden = np.asarray((depth_m > 0) & (depth_m < z - margin))
    return np.where(hidden[:, None], np.nan, px)


def table(matches: Sequence[TrackerMatches]) -> list[str]:
    """A line for each tracker."""
    lines = [f"{'tracker':12s} points  found  precision  recall  prepare, ms  ms a frame"]
    for m in matches:
        precision, recall = (
            "-" if value is None else f"{value:.3f}" for value in (m.precision, m.recall)
        )
        lines.append(
            f"{m.name:12s} {len(m.px):6d} {m.found.sum():6d} {precision:>10s} {recall:>7s}"
            f" {m.prepare_ms:12.1f} {m.ms:11.1f}"
        )
    return lines
