"""A pose that many matches agree with, from random minimal sets.

Source: Fischler, Bolles 1981; scored as by Torr, Zisserman 2000; refined on the inliers of the
best as by Chum, Matas, Kittler 2003; claim 4, 2.10.
"""

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.core.camera import Intrinsics
from vnav.localisation.minimal import SIX, THREE, VAGUE, Minimal
from vnav.localisation.refine import Lens, Sightings, refine
from vnav.localisation.view import MIN_DEPTH_M, View

Array = NDArray[np.float64]

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
    needed = min(terms.iterations, _draws(terms.least / max(len(px), 1), minimal.size))
    best: View | None = None
    best_score, drawn = np.inf, 0
    while drawn < needed and len(px) >= terms.least:
        rows = _minimal_sets(len(px), minimal.size, rng)
        poses, factors = minimal.solve(lens, points[rows], px[rows])
        drawn += BATCH
        if not len(poses):
            continue
        errors = _errors(poses, factors, lens.intrinsics, seen) / terms.threshold_px**2
        score = np.minimum(errors, 1).sum(1)
        k = int(score.argmin())
        if score[k] < best_score:
            best, best_score = _view(poses[k], factors[k], lens.intrinsics), score[k]
            needed = min(needed, _draws((errors[k] < 1).mean(), minimal.size))
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


def _errors(poses: Array, focal: Array, k: Intrinsics, seen: Sightings) -> Array:
    """Squared reprojection errors (H, M) in pixels, inf behind the camera."""
    K = np.zeros((len(poses), 3, 3))
    K[:, 0, 0], K[:, 1, 1], K[:, 2, 2] = k.fx * focal, k.fy * focal, 1
    K[:, 0, 2], K[:, 1, 2] = k.cx, k.cy
    P = np.swapaxes(K @ poses, 0, 1).reshape(-1, 4)
    points = np.column_stack([seen.points_world, np.ones(len(seen.px))])
    x, y, z = (P @ points.T).reshape(3, len(poses), -1)
    front = z > MIN_DEPTH_M
    inverse_z = 1 / np.where(front, z, 1)
    x *= inverse_z
    x -= seen.px[:, 0]
    y *= inverse_z
    y -= seen.px[:, 1]
    return np.where(front, x * x + y * y, np.inf)


def _view(pose: Array, focal: float, k: Intrinsics) -> View:
    T = np.vstack([pose, [0, 0, 0, 1]])
    return View(T, dataclasses.replace(k, fx=k.fx * focal, fy=k.fy * focal))
