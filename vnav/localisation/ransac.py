"""A pose that many matches agree with, from random minimal sets.

Source: Fischler, Bolles 1981; scored as by Torr, Zisserman 2000; refined on the inliers of the
best as by Chum, Matas, Kittler 2003; claim 4, 2.10.
"""

import dataclasses
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.localisation.minimal import SIX, THREE, VAGUE, Minimal
from vnav.localisation.refine import Lens, Sightings, refine
from vnav.localisation.view import MIN_DEPTH_M, View

BATCH = 128  # minimal sets solved at once
CONFIDENCE = 0.999  # that one set of inliers alone was drawn
LOCAL_ROUNDS = 2  # refinements on the inliers of the best hypothesis


@dataclass(frozen=True)
class Terms:
    """What counts as agreement, how many must agree, and how long to try."""

    threshold_px: float
    least: int
    iterations: int
    solver: str


@dataclass(frozen=True)
class Consensus:
    """A view, and which of the matches (M,) agree with it."""

    view: View
    inliers: NDArray[np.bool_]

    @property
    def size(self) -> int:
        """How many agree."""
        return int(self.inliers.sum())


def agree(lens: Lens, seen: Sightings, terms: Terms, rng: np.random.Generator) -> Consensus | None:
    """The view that most sightings, the best of them first, agree with; None where too few do.

    Six points by the direct linear transform where the focal length is unknown or the terms ask
    for it; three where they cannot do (few points, a plane), with an unknown focal length always.
    """
    unknown = lens.focal_sigma > VAGUE
    found: list[Consensus] = []
    if (terms.solver == "dlt" or (terms.solver == "auto" and unknown)) and len(seen.px) >= 6:
        found += _agree_by(SIX, lens, seen, terms, rng)
    if unknown or not found:
        found += _agree_by(THREE, lens, seen, terms, rng)
    return max(found, key=lambda c: c.size, default=None)


def _agree_by(
    minimal: Minimal, lens: Lens, seen: Sightings, terms: Terms, rng: np.random.Generator
) -> list[Consensus]:
    """The consensus that minimal sets of one kind lead to, if one does."""
    points, px = seen.points_world.astype(float), seen.px.astype(float)
    K = lens.intrinsics
    camera = K.fx, K.fy, K.cx, K.cy, terms.threshold_px
    needed = min(terms.iterations, _draws(terms.least / max(len(px), 1), minimal.size))
    best: View | None = None
    best_cost, drawn = np.inf, 0
    while drawn < needed and len(px) >= terms.least:
        rows = _minimal_sets(len(px), minimal.size, rng)
        poses, factors = minimal.solve(lens, points[rows], px[rows])
        drawn += BATCH
        k, cost, agreeing = _best(poses, factors, camera, points, px, best_cost)
        if k >= 0:
            best, best_cost = _view(poses[k], factors[k], lens.intrinsics), cost
            needed = min(needed, _draws(agreeing / len(px), minimal.size))
    return [] if best is None else _locally_optimised(best, lens, seen, terms)


def _draws(inlier_share: float, size: int) -> int:
    """How many minimal sets make one without an outlier likely."""
    clean = np.clip(inlier_share**size, 1e-9, 1 - 1e-9)
    return int(np.ceil(np.log(1 - CONFIDENCE) / np.log(1 - clean)))


def _locally_optimised(view: View, lens: Lens, seen: Sightings, terms: Terms) -> list[Consensus]:
    """The best hypothesis refined on its inliers, if enough remain."""
    inliers = _agreeing(view, seen, terms)
    for _ in range(LOCAL_ROUNDS):
        if inliers.sum() < terms.least:
            return []
        view = refine(view, seen[inliers], lens).view
        inliers = _agreeing(view, seen, terms)
    return [Consensus(view, inliers)] if inliers.sum() >= terms.least else []


def _agreeing(view: View, seen: Sightings, terms: Terms) -> NDArray[np.bool_]:
    return np.asarray(view.squared_errors(seen.points_world, seen.px) < terms.threshold_px**2)


def _minimal_sets(count: int, size: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Rows (BATCH, size), none twice in a set; of better (earlier) matches more often."""
    weight = np.linspace(1.0, 0.25, count)
    keys = rng.exponential(size=(BATCH, count)) / weight
    return np.argpartition(keys, size - 1, 1)[:, :size]


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
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
