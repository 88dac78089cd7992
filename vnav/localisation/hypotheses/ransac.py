"""A pose that many matches agree with, from random minimal sets.

Source: Fischler, Bolles 1981; scored as by Torr, Zisserman 2000; refined on the inliers of the
best as by Chum, Matas, Kittler 2003; claim 4, 2.10.
"""

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Array
from vnav.core.camera import CameraPrior, Intrinsics
from vnav.localisation.hypotheses.minimal_solvers import (
    DLT,
    P3P,
    UNKNOWN_FOCAL_SIGMA,
    MinimalSolver,
)
from vnav.localisation.hypotheses.pose_refinement import refine_pose
from vnav.localisation.matches import Correspondences2D3D
from vnav.localisation.view import MIN_DEPTH_M, View

BATCH = 128  # minimal sets solved at once
CONFIDENCE = 0.999  # that one set of inliers alone was drawn
LOCAL_ROUNDS = 2  # refinements on the inliers of the best hypothesis


@dataclass(frozen=True)
class RansacOptions:
    """What counts as an inlier, how many there must be, and how long to try."""

    threshold_px: float
    min_inliers: int
    max_iterations: int
    solver: str


@dataclass(frozen=True)
class PoseHypothesis:
    """A view, and which of the matches (M,) agree with it."""

    view: View
    inlier_mask: NDArray[np.bool_]

    @property
    def inliers(self) -> int:
        """Number of matches that agree."""
        return int(self.inlier_mask.sum())


def estimate_absolute_pose(
    matched: Correspondences2D3D,
    camera: CameraPrior,
    options: RansacOptions,
    rng: np.random.Generator,
) -> PoseHypothesis | None:
    """The view that most correspondences agree with; None where too few do. The best come first.

    Six points by the direct linear transform where the focal length is unknown or the options ask
    for it; three where they cannot do (few points, a plane), with an unknown focal length always.
    """
    unknown = camera.focal_sigma > UNKNOWN_FOCAL_SIGMA
    found: list[PoseHypothesis] = []
    if (options.solver == "dlt" or (options.solver == "auto" and unknown)) and len(matched.px) >= 6:
        found += _ransac(DLT, matched, camera, options, rng)
    if unknown or not found:
        found += _ransac(P3P, matched, camera, options, rng)
    return max(found, key=lambda hypothesis: hypothesis.inliers, default=None)


def _ransac(
    minimal: MinimalSolver,
    matched: Correspondences2D3D,
    camera: CameraPrior,
    options: RansacOptions,
    rng: np.random.Generator,
) -> list[PoseHypothesis]:
    """The hypothesis that minimal sets of one kind lead to, if one does."""
    points, px = matched.points_world.astype(float), matched.px.astype(float)
    K = camera.intrinsics
    limits = K.fx, K.fy, K.cx, K.cy, options.threshold_px
    needed = min(
        options.max_iterations, _draws(options.min_inliers / max(len(px), 1), minimal.size)
    )
    best: View | None = None
    best_cost, drawn = np.inf, 0
    while drawn < needed and len(px) >= options.min_inliers:
        rows = _minimal_sets(len(px), minimal.size, rng)
        poses, factors = minimal.solve(camera, points[rows], px[rows])
        drawn += BATCH
        k, cost, agreeing = _best(poses, factors, limits, points, px, best_cost)
        if k >= 0:
            best, best_cost = _view(poses[k], factors[k], K), cost
            needed = min(needed, _draws(agreeing / len(px), minimal.size))
    return [] if best is None else _locally_optimised(best, matched, camera, options)


def _draws(inlier_share: float, size: int) -> int:
    """How many minimal sets make one without an outlier likely."""
    clean = np.clip(inlier_share**size, 1e-9, 1 - 1e-9)
    return int(np.ceil(np.log(1 - CONFIDENCE) / np.log(1 - clean)))


def _locally_optimised(
    view: View, matched: Correspondences2D3D, camera: CameraPrior, options: RansacOptions
) -> list[PoseHypothesis]:
    """The best hypothesis refined on its inliers, if enough remain."""
    inliers = _inliers(view, matched, options)
    for _ in range(LOCAL_ROUNDS):
        if inliers.sum() < options.min_inliers:
            return []
        view = refine_pose(view, matched[inliers], camera).view
        inliers = _inliers(view, matched, options)
    return [PoseHypothesis(view, inliers)] if inliers.sum() >= options.min_inliers else []


def _inliers(view: View, matched: Correspondences2D3D, options: RansacOptions) -> NDArray[np.bool_]:
    errors = view.squared_errors(matched.points_world, matched.px)
    return np.asarray(errors < options.threshold_px**2)


def _minimal_sets(count: int, size: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Rows (BATCH, size), none twice in a set; of better (earlier) matches more often."""
    weight = np.linspace(1.0, 0.25, count)
    keys = rng.exponential(size=(BATCH, count)) / weight
    return np.argpartition(keys, size - 1, 1)[:, :size]


@compiled
def _best(
    poses: Array,
    factors: Array,
    camera: tuple[float, float, float, float, float],
    points_world: Array,
    px: Array,
    most: float,
) -> tuple[int, float, int]:
    """Which pose has the lowest cost, if below ``most``, else -1; its cost, and how many agree.

    ``camera``: fx, fy, cx, cy, and the threshold, in pixels. The cost is the sum of the truncated
    squared errors over the squared threshold; a pose is left where it exceeds the best.
    """
    fx, fy, cx, cy, threshold_px = camera
    best, best_agreeing = -1, 0
    for h in range(len(poses)):
        P, focal, cost, agreeing = poses[h], factors[h], 0.0, 0
        for m in range(len(px)):
            X, Y, Z = points_world[m]
            z = P[2, 0] * X + P[2, 1] * Y + P[2, 2] * Z + P[2, 3]
            error = 1.0
            if z > MIN_DEPTH_M:
                x = P[0, 0] * X + P[0, 1] * Y + P[0, 2] * Z + P[0, 3]
                y = P[1, 0] * X + P[1, 1] * Y + P[1, 2] * Z + P[1, 3]
                u, v = fx * focal * x / z + cx - px[m, 0], fy * focal * y / z + cy - px[m, 1]
                error = (u * u + v * v) / threshold_px**2
            agreeing += error < 1
            cost += min(error, 1.0)
            if cost >= most:
                break
        else:
            best, most, best_agreeing = h, cost, agreeing
    return best, most, best_agreeing


def _view(pose: Array, focal: float, k: Intrinsics) -> View:
    T = np.vstack([pose, [0, 0, 0, 1]])
    return View(T, dataclasses.replace(k, fx=k.fx * focal, fy=k.fy * focal))
