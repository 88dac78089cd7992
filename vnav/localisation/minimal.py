"""The smallest sets of points that make a pose."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.localisation.dlt import dlt, focal_of, poses_of
from vnav.localisation.p3p import p3p
from vnav.localisation.refine import Lens

VAGUE = 0.2  # relative standard deviation of a focal length that tells next to nothing
LADDER = np.geomspace(0.5, 2.0, 7)  # focal lengths tried then, as factors of the guess


@dataclass(frozen=True)
class Minimal:
    """How many points make a pose, and how.

    ``solve`` takes points (S, size, 3) and pixels (S, size, 2) of sets; it gives poses (H, 3, 4)
    ``T_camera_world`` and focal lengths (H,) as factors of the lens' own.
    """

    size: int
    solve: Callable[[Lens, Array, Array], tuple[Array, Array]]


def _by_three(lens: Lens, points: Array, px: Array) -> tuple[Array, Array]:
    """Three points do with a focal length: the lens' own, or those that are likely."""
    sigma = lens.focal_sigma
    likely = LADDER if sigma > VAGUE else np.unique([1 - sigma, 1, 1 + sigma])
    centred, depth = _centred(lens.intrinsics, px), np.ones((*px.shape[:2], 1))
    found = []
    for factor in likely:
        rays = np.concatenate([centred / factor, depth], 2)
        found.append(p3p(rays / np.linalg.norm(rays, axis=2, keepdims=True), points))
    return np.concatenate(found), np.repeat(likely, [len(f) for f in found])


def _by_dlt(lens: Lens, points: Array, px: Array) -> tuple[Array, Array]:
    """Six points: projected onto the intrinsics, or with a focal length of their own."""
    with np.errstate(all="ignore"):
        P = dlt(_centred(lens.intrinsics, px), points)
        factors = np.ones(len(P)) if lens.focal_sigma <= VAGUE else focal_of(P)
        poses = poses_of(P / np.stack([factors, factors, np.ones(len(P))], 1)[:, :, None])
    likely = (factors > LADDER[0] / 2) & (factors < LADDER[-1] * 2)
    good = np.isfinite(poses).all((1, 2)) & likely
    return poses[good], factors[good]


def _centred(k: Intrinsics, px: Array) -> Array:
    """Pixels (..., 2) as coordinates on the plane at depth 1."""
    return (px - [k.cx, k.cy]) / [k.fx, k.fy]


THREE, SIX = Minimal(3, _by_three), Minimal(6, _by_dlt)
