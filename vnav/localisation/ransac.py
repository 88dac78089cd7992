"""A pose that many matches agree with, from random minimal sets.

Source: Fischler, Bolles 1981; scored as by Torr, Zisserman 2000; refined on the inliers of the
best as by Chum, Matas, Kittler 2003; claim 4, 2.10.
"""

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.core.camera import Intrinsics
from vnav.localisation.dlt import dlt, focal_of, poses_of
from vnav.localisation.p3p import p3p
from vnav.localisation.refine import Focal, Sightings, refine
from vnav.localisation.view import View

Array = NDArray[np.float64]

BATCH = 128  # minimal sets solved at once
CONFIDENCE = 0.999  # that one set of inliers alone was drawn
LOCAL_ROUNDS = 2  # refinements on the inliers of the best hypothesis
VAGUE = 0.2  # relative standard deviation of a focal length that tells next to nothing
LADDER = np.geomspace(0.5, 2.0, 7)  # focal lengths tried then, as factors of the guess


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


def agree(
    guess: Intrinsics, focal: Focal, seen: Sightings, terms: Terms, rng: np.random.Generator
) -> Consensus | None:
    """The view that most sightings, the best of them first, agree with; None where too few do."""
    best: View | None = None
    by_dlt = terms.solver == "dlt" or (terms.solver == "auto" and focal.sigma > VAGUE)
    size = 6 if by_dlt else 3
    needed = min(terms.iterations, _draws(terms.least / max(len(seen.px), 1), size))
    best_score, drawn = np.inf, 0
    while drawn < needed and len(seen.px) >= terms.least:
        poses, factors = _hypotheses(guess, focal, seen, by_dlt, rng)
        drawn += BATCH
        if not len(poses):
            continue
        errors = _errors(poses, factors, guess, seen) / terms.threshold_px**2
        score = np.minimum(errors, 1).sum(1)
        k = int(score.argmin())
        if score[k] < best_score:
            best, best_score = _view(poses[k], factors[k], guess), score[k]
            needed = min(needed, _draws((errors[k] < 1).mean(), size))
    if best is None:
        return None
    return _locally_optimised(best, focal, seen, terms)


def _draws(inlier_share: float, size: int) -> int:
    """How many minimal sets make one without an outlier likely."""
    clean = np.clip(inlier_share**size, 1e-9, 1 - 1e-9)
    return int(np.ceil(np.log(1 - CONFIDENCE) / np.log(1 - clean)))


def _locally_optimised(view: View, focal: Focal, seen: Sightings, terms: Terms) -> Consensus | None:
    """The best hypothesis refined on its inliers, None where too few remain."""
    inliers = _agreeing(view, seen, terms)
    for _ in range(LOCAL_ROUNDS):
        if inliers.sum() < terms.least:
            return None
        view = refine(view, seen[inliers], focal).view
        inliers = _agreeing(view, seen, terms)
    return Consensus(view, inliers) if inliers.sum() >= terms.least else None


def _agreeing(view: View, seen: Sightings, terms: Terms) -> NDArray[np.bool_]:
    return np.asarray(view.squared_errors(seen.points_world, seen.px) < terms.threshold_px**2)


def _hypotheses(
    guess: Intrinsics, focal: Focal, seen: Sightings, by_dlt: bool, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Poses (H, 3, 4) ``T_camera_world`` of one batch of sets, and focal lengths (H,) as factors.

    The factor is of the guess. Points too few for the direct linear transform, or in one plane,
    leave it to three points, with the focal lengths that are likely.
    """
    points, px = seen.points_world.astype(float), seen.px.astype(float)
    poses, factors = np.zeros((0, 3, 4)), np.zeros(0)
    if len(px) >= 6 and by_dlt:
        rows = _minimal_sets(len(px), 6, rng)
        poses, factors = _by_dlt(guess, focal, points[rows], px[rows])
    if len(poses) and focal.sigma <= VAGUE:
        return poses, factors
    rows = _minimal_sets(len(px), 3, rng)
    likely = LADDER if focal.sigma > VAGUE else np.unique([1 - focal.sigma, 1, 1 + focal.sigma])
    more = [_by_three(guess, factor, points[rows], px[rows]) for factor in likely]
    counts = [len(m) for m in more]
    return np.concatenate([poses, *more]), np.append(factors, np.repeat(likely, counts))


def _by_three(guess: Intrinsics, factor: float, points: Array, px: Array) -> Array:
    rays = np.concatenate([_centred(guess, px) / factor, np.ones((*px.shape[:2], 1))], 2)
    return p3p(rays / np.linalg.norm(rays, axis=2, keepdims=True), points)


def _by_dlt(guess: Intrinsics, focal: Focal, points: Array, px: Array) -> tuple[Array, Array]:
    """By the direct linear transform: projected onto the intrinsics, or with its own focal."""
    with np.errstate(all="ignore"):
        P = dlt(_centred(guess, px), points)
        factors = np.ones(len(P)) if focal.sigma <= VAGUE else focal_of(P)
        poses = poses_of(P / np.stack([factors, factors, np.ones(len(P))], 1)[:, :, None])
    likely = (factors > LADDER[0] / 2) & (factors < LADDER[-1] * 2)
    good = np.isfinite(poses).all((1, 2)) & likely
    return poses[good], factors[good]


def _centred(k: Intrinsics, px: Array) -> Array:
    """Pixels (..., 2) as coordinates on the plane at depth 1."""
    return (px - [k.cx, k.cy]) / [k.fx, k.fy]


def _minimal_sets(count: int, size: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Rows (BATCH, size), none twice in a set; of better (earlier) matches more often."""
    weight = np.linspace(1.0, 0.25, count)
    keys = rng.exponential(size=(BATCH, count)) / weight
    return np.argpartition(keys, size - 1, 1)[:, :size]


def _errors(poses: Array, focal: Array, k: Intrinsics, seen: Sightings) -> Array:
    """Squared reprojection errors (H, M) in pixels, inf behind the camera."""
    p = poses[:, :, :3] @ seen.points_world.T.astype(float) + poses[:, :, 3:]
    z = np.where(p[:, 2] > 1e-3, p[:, 2], np.nan)
    u = k.fx * focal[:, None] * p[:, 0] / z + k.cx - seen.px[:, 0]
    v = k.fy * focal[:, None] * p[:, 1] / z + k.cy - seen.px[:, 1]
    return np.asarray(np.nan_to_num(u * u + v * v, nan=np.inf))


def _view(pose: Array, focal: float, k: Intrinsics) -> View:
    T = np.vstack([pose, [0, 0, 0, 1]])
    return View(T, dataclasses.replace(k, fx=k.fx * focal, fy=k.fy * focal))
