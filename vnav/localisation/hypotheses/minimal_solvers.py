"""Poses from the fewest points that determine one."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vnav.compiled.p3p import p3p
from vnav.core.arrays import Array
from vnav.core.camera import CameraPrior, Intrinsics
from vnav.localisation.hypotheses.dlt import dlt, focal_of, poses_of

UNKNOWN_FOCAL_SIGMA = 0.2  # relative; a focal length with more is as good as unknown
FOCAL_FACTORS = np.geomspace(0.5, 2.0, 7)  # focal lengths tried then, as factors of the guess


@dataclass(frozen=True)
class MinimalSolver:
    """How many points make a pose, and how.

    ``solve`` takes points (S, size, 3) and pixels (S, size, 2) of sets; it gives poses (H, 3, 4)
    ``T_camera_world`` and focal lengths (H,) as factors of the camera's own.
    """

    size: int
    solve: Callable[[CameraPrior, Array, Array], tuple[Array, Array]]


def _by_p3p(camera: CameraPrior, points: Array, px: Array) -> tuple[Array, Array]:
    """Three points suffice with a focal length: the camera's own, or those that are likely."""
    sigma = camera.focal_sigma
    likely = FOCAL_FACTORS if sigma > UNKNOWN_FOCAL_SIGMA else np.unique([1 - sigma, 1, 1 + sigma])
    centred, depth = _centred(camera.intrinsics, px), np.ones((*px.shape[:2], 1))
    found = []
    for factor in likely:
        rays = np.concatenate([centred / factor, depth], 2)
        found.append(p3p(rays / np.linalg.norm(rays, axis=2, keepdims=True), points))
    return np.concatenate(found), np.repeat(likely, [len(f) for f in found])


def _by_dlt(camera: CameraPrior, points: Array, px: Array) -> tuple[Array, Array]:
    """Six points: projected onto the intrinsics, or with a focal length of their own."""
    with np.errstate(all="ignore"):
        P = dlt(_centred(camera.intrinsics, px), points)
        factors = np.ones(len(P)) if camera.focal_sigma <= UNKNOWN_FOCAL_SIGMA else focal_of(P)
        poses = poses_of(P / np.stack([factors, factors, np.ones(len(P))], 1)[:, :, None])
    likely = (factors > FOCAL_FACTORS[0] / 2) & (factors < FOCAL_FACTORS[-1] * 2)
    good = np.isfinite(poses).all((1, 2)) & likely
    return poses[good], factors[good]


def _centred(k: Intrinsics, px: Array) -> Array:
    """Pixels (..., 2) as coordinates on the plane at depth 1."""
    return (px - [k.cx, k.cy]) / [k.fx, k.fy]


P3P, DLT = MinimalSolver(3, _by_p3p), MinimalSolver(6, _by_dlt)
