"""How far estimated poses are from the truth; docs/scoring.md defines every figure.

Source: Sturm, Engelhard, Endres, Burgard, Cremers: A Benchmark for the Evaluation of RGB-D SLAM
Systems, IROS 2012, and the tools published with it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vnav.core import se3
from vnav.core.arrays import Array

Pairs = NDArray[np.intp]
Limit = tuple[float, float]  # metres, degrees
NEAR: tuple[Limit, ...] = ((0.05, 5.0), (0.10, 3.0), (0.25, 10.0))
WRONG: Limit = (0.30, 10.0)
TOLERANCE = 0.1  # share of a distance or time by which a pair's may differ from the one asked


@dataclass(frozen=True)
class Statistics:
    """Of the absolute values of N errors; N = 0 gives NaN."""

    rmse: float
    mean: float
    median: float
    max: float

    @classmethod
    def of(cls, errors: ArrayLike) -> "Statistics":
        """Root mean square, mean, median and largest of errors (N,)."""
        e = np.abs(np.asarray(errors, float))
        if not len(e):
            return cls(np.nan, np.nan, np.nan, np.nan)
        rmse = float(np.sqrt((e**2).mean()))
        return cls(rmse, float(e.mean()), float(np.median(e)), float(e.max()))


@dataclass(frozen=True)
class AbsoluteError:
    """ATE: distances between aligned estimated and true positions.

    ``T_truth_world`` (4, 4) is the alignment that was applied, ``scale`` by how much the estimate
    would have to grow to fit best, which was **not** applied (NaN for an estimate of one place).
    """

    translation_m: Statistics
    T_truth_world: Array
    scale: float


@dataclass(frozen=True)
class RelativeError:
    """RPE: how far estimated motions are from the true ones, over a number of pairs of poses."""

    translation_m: Statistics
    rotation_deg: Statistics
    pairs: int


def absolute_error(T_world_camera: ArrayLike, T_truth_camera: ArrayLike) -> AbsoluteError:
    """ATE of N >= 1 poses (N, 4, 4) against the true ones, after SE(3) alignment of positions."""
    estimate = np.asarray(T_world_camera, float)[:, :3, 3]
    truth = np.asarray(T_truth_camera, float)[:, :3, 3]
    T_truth_world = se3.align(truth, estimate)
    errors = np.linalg.norm(se3.transform(T_truth_world, estimate) - truth, axis=1)
    return AbsoluteError(
        Statistics.of(errors), T_truth_world, _scale(T_truth_world, estimate, truth)
    )


def scaled(T_world_camera: ArrayLike, T_truth_camera: ArrayLike) -> tuple[Array, float]:
    """Poses (N, 4, 4) grown to the scale that fits the true ones best, and that scale.

    With the alignment of `absolute_error` that is the similarity of Umeyama 1991, Sim(3). NaN for
    an estimate of one place.
    """
    poses = np.array(T_world_camera, float)
    scale = absolute_error(poses, T_truth_camera).scale
    poses[:, :3, 3] *= scale
    return poses, scale


def _scale(T_truth_world: Array, estimate: Array, truth: Array) -> float:
    """The scale of the similarity that fits best (Umeyama 1991); its rotation is the same."""
    turned = (estimate - estimate.mean(0)) @ T_truth_world[:3, :3].T
    spread = float((turned**2).sum())
    return float(((truth - truth.mean(0)) * turned).sum()) / spread if spread > 0 else np.nan


def relative_error(
    T_world_camera: ArrayLike, T_truth_camera: ArrayLike, pairs: Pairs
) -> RelativeError:
    """RPE of poses (N, 4, 4) against the true ones over pairs (P, 2) of their rows; P = 0: NaN."""
    estimate, truth = np.asarray(T_world_camera, float), np.asarray(T_truth_camera, float)
    i, j = pairs[:, 0], pairs[:, 1]
    estimated_motion = se3.inverse(estimate[i]) @ estimate[j]
    true_motion = se3.inverse(truth[i]) @ truth[j]
    error = se3.inverse(true_motion) @ estimated_motion
    distances_m = np.linalg.norm(error[:, :3, 3], axis=1)
    angles_deg = np.rad2deg(se3.rotation_angle(error))
    return RelativeError(Statistics.of(distances_m), Statistics.of(angles_deg), len(pairs))


def pairs_over_frames(count: int, frames: int) -> Pairs:
    """Every pair (P, 2) of rows that lie ``frames`` apart, of ``count`` rows."""
    first = np.arange(max(count - frames, 0))
    return np.stack([first, first + frames], 1)


def pairs_over_path(positions: ArrayLike, distance_m: float) -> Pairs:
    """Each row of positions (N, 3) with the later one nearest to ``distance_m`` along the path."""
    steps = np.linalg.norm(np.diff(np.asarray(positions, float), axis=0), axis=1)
    return _pairs_apart(np.append(0.0, np.cumsum(steps)), distance_m)


def pairs_over_time(stamps_s: ArrayLike, duration_s: float) -> Pairs:
    """Each row of times (N,) with the later one nearest to ``duration_s`` after it."""
    return _pairs_apart(np.asarray(stamps_s, float), duration_s)


def _pairs_apart(progress: Array, delta: float) -> Pairs:
    """Each row with the later row whose progress (N,) grew nearest to delta, within TOLERANCE."""
    pairs = []
    for i in range(len(progress) - 1):
        off = np.abs(progress[i + 1 :] - progress[i] - delta)
        nearest = int(off.argmin())
        if off[nearest] <= TOLERANCE * delta:
            pairs.append((i, i + 1 + nearest))
    return np.array(pairs, np.intp).reshape(-1, 2)


def relocalisation_error(
    T_world_camera: ArrayLike, T_world_truth: ArrayLike
) -> tuple[Array, Array]:
    """Distances in metres and angles in degrees (...) between poses (..., 4, 4) in one world."""
    off = se3.inverse(T_world_truth) @ np.asarray(T_world_camera, float)
    return np.linalg.norm(off[..., :3, 3], axis=-1), np.rad2deg(se3.rotation_angle(off))


@dataclass(frozen=True)
class Relocalisation:
    """How well photos were found.

    ``within``: shares of **all** photos that lie within each limit of NEAR; ``wrong``: located
    beyond one of WRONG; medians of the located, NaN without one.
    """

    photos: int
    located: int
    within: tuple[float, ...]
    wrong: int
    median_m: float
    median_deg: float

    @classmethod
    def of(cls, off_m: ArrayLike, off_deg: ArrayLike, photos: int) -> "Relocalisation":
        """From the errors (N,) of the located ones of that many photos."""
        m, deg = np.asarray(off_m, float), np.asarray(off_deg, float)
        inside = [int(((m <= near_m) & (deg <= near_deg)).sum()) for near_m, near_deg in NEAR]
        return cls(
            photos,
            len(m),
            tuple(count / photos if photos else np.nan for count in inside),
            int(((m > WRONG[0]) | (deg > WRONG[1])).sum()),
            float(np.median(m)) if len(m) else np.nan,
            float(np.median(deg)) if len(m) else np.nan,
        )
