"""An estimated trajectory against the true one: ATE and RPE by the TUM definitions."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from vnav.core.arrays import Array
from vnav.core.association import associate, span
from vnav.core.trajectory import Trajectory
from vnav.errors import TrajectoryError
from vnav.evaluation import metrics

MIN_PAIRS = 3  # what an alignment takes
SE3, SIM3 = "se3", "sim3"
ALIGNMENTS = {SE3: "SE(3)", SIM3: "Sim(3)"}  # with and without a scale


@dataclass(frozen=True)
class Score:
    """What `score` finds; ``paths_m``: true and estimated length, through the pairs only.

    ``align``: "se3" or "sim3"; ``scale``: by how much the estimate would have to grow to fit best,
    or has grown; NaN for an estimate of one place.
    """

    pairs: int
    poses: int
    truth_poses: int
    duration_s: float
    paths_m: tuple[float, float]
    align: str
    scale: float
    ate: metrics.AbsoluteError
    rpe: dict[str, metrics.RelativeError]  # keys "N frames", "1 m", "1 s"

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON; null where there is nothing to average."""
        ate, scale = self.ate, self.scale
        return {
            "pairs": self.pairs,
            "poses": self.poses,
            "truth_poses": self.truth_poses,
            "duration_s": self.duration_s,
            "path_truth_m": self.paths_m[0],
            "path_estimate_m": self.paths_m[1],
            "align": self.align,
            "scale": scale if np.isfinite(scale) else None,
            "T_truth_world": ate.T_truth_world.tolist(),
            "ate_m": asdict(ate.translation_m),
            "rpe": {name: _plain(error) for name, error in self.rpe.items()},
        }


def score(
    estimate: Trajectory,
    truth: Trajectory,
    max_difference_s: float,
    frames: int = 1,
    align: str = SE3,
) -> Score:
    """ATE, and RPE over ``frames`` frames, 1 m and 1 s, of the poses whose times agree.

    Poses are paired one to one by times that differ by less than ``max_difference_s``. Pairs of
    poses for RPE are chosen on the estimate, as TUM's tool and evo do. With ``align`` "sim3" the
    estimate is scaled to the truth before anything is measured. TrajectoryError where fewer than
    three are paired, or an estimate that never moves has no scale.
    """
    matches = associate(estimate.stamps_s, truth.stamps_s, max_difference_s)
    if len(matches) < MIN_PAIRS:
        raise TrajectoryError(_too_few(estimate, truth, len(matches), max_difference_s))
    stamps_s = estimate.stamps_s[matches[:, 0]]
    poses, true_poses = estimate.T_world_camera[matches[:, 0]], truth.T_world_camera[matches[:, 1]]
    grown, scale = metrics.scaled(poses, true_poses)
    if align == SIM3:
        poses = _with_scale(grown, scale)
    over = {
        f"{frames} frame{'s' * (frames > 1)}": metrics.pairs_over_frames(len(poses), frames),
        "1 m": metrics.pairs_over_path(poses[:, :3, 3], 1.0),
        "1 s": metrics.pairs_over_time(stamps_s, 1.0),
    }
    return Score(
        len(matches),
        len(estimate),
        len(truth),
        float(stamps_s[-1] - stamps_s[0]),
        (Trajectory(stamps_s, true_poses).length_m, Trajectory(stamps_s, poses).length_m),
        align,
        scale,
        metrics.absolute_error(poses, true_poses),
        {name: metrics.relative_error(poses, true_poses, pairs) for name, pairs in over.items()},
    )


def _with_scale(grown: Array, scale: float) -> Array:
    if not scale > 0:
        raise TrajectoryError(
            f"expected an estimate that moves as the truth does, found a scale of {scale:.4g}; use"
            " --align se3"
        )
    return grown


def table(result: Score) -> list[str]:
    """Lines for a person."""
    ate = result.ate
    lines = [
        f"pairs      {result.pairs} of {result.poses} poses, {result.truth_poses} true ones",
        f"path       {result.paths_m[0]:.3f} m true, {result.paths_m[1]:.3f} m estimated,"
        f" {result.duration_s:.1f} s",
        f"scale      {result.scale:.4f} "
        + ("applied" if result.align == SIM3 else "would fit best (not applied)"),
        "",
        f"{'':22}{'rmse':>10}{'mean':>10}{'median':>10}{'max':>10}{'pairs':>8}",
        _row(f"ATE, {ALIGNMENTS[result.align]} aligned", "m", ate.translation_m, result.pairs),
    ]
    for name, error in result.rpe.items():
        lines.append(_row(f"RPE over {name}", "m", error.translation_m, error.pairs))
        lines.append(_row("", "deg", error.rotation_deg, error.pairs))
    return lines


def _row(name: str, unit: str, statistics: metrics.Statistics, pairs: int) -> str:
    values = (statistics.rmse, statistics.mean, statistics.median, statistics.max)
    numbers = "".join(f"{'-':>10}" if np.isnan(v) else f"{v:10.4f}" for v in values)
    return f"{name:18} {unit:3}{numbers}{pairs:8}"


def _plain(error: metrics.RelativeError) -> dict[str, Any]:
    return {
        "pairs": error.pairs,
        "translation_m": asdict(error.translation_m) if error.pairs else None,
        "rotation_deg": asdict(error.rotation_deg) if error.pairs else None,
    }


def _too_few(estimate: Trajectory, truth: Trajectory, found: int, max_difference_s: float) -> str:
    spans = f"{span(estimate.stamps_s)} and {span(truth.stamps_s)}"
    return (
        f"expected at least {MIN_PAIRS} poses with a true one within {max_difference_s:g} s, found"
        f" {found} of {len(estimate)} poses and {len(truth)} true ones, from {spans}; check that"
        " both have the same clock, or allow more with --max-difference"
    )
