"""The floor: the plane that much surface lies on, hardly any under, seen upright by all cameras."""

import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array
from vnav.optimisation.surface import Surface

BAND_M = 0.04  # half the thickness of what counts as one plane
BELOW_M = 0.15  # what lies deeper than this lies under the plane
MAX_BELOW = 0.02  # share of the surface that may lie under a floor: reflections, noise
MIN_SUPPORT = 0.02  # share of the surface that must lie on it
HEIGHTS_M = (0.15, 3.0)  # above a floor of the cameras on it
LOWEST = 0.1  # share of the cameras that are on it at least; a stair may lead to others
STEADY = 0.7  # length of the mean of a floor's normals in all cameras; a wall's turns about
UPRIGHT = 0.25  # of it across the optical axis: the cameras do not look straight down
HYPOTHESES = 500
COS_SAME = float(np.cos(np.deg2rad(15)))


def find_floor(
    surface: Surface, T_any_camera: Array, rng: np.random.Generator
) -> tuple[Array, float, NDArray[np.bool_]] | None:
    """Up, height along it, and which points lie on the floor; None where none is convincing."""
    if not len(surface.points):
        return None
    best, best_score = None, 0.0
    for k in rng.integers(0, len(surface.points), HYPOTHESES):
        score = _floor_score(surface, surface.normals[k], surface.points[k], T_any_camera)
        if score > best_score:
            best, best_score = int(k), score
    if best is None:
        return None
    up, height = surface.normals[best], float(surface.points[best] @ surface.normals[best])
    for _ in range(5):
        members = _members(surface, up, height)
        centre = surface.points[members].mean(0)
        up = np.linalg.svd(surface.points[members] - centre, full_matrices=False)[2][2]
        up = up if up @ surface.normals[best] > 0 else -up
        height = float(centre @ up)
    return up, height, _members(surface, up, height)


def _members(surface: Surface, up: Array, height: float) -> NDArray[np.bool_]:
    near = np.abs(surface.points @ up - height) < BAND_M
    return np.asarray(near & (surface.normals @ up > COS_SAME))


def _floor_score(surface: Surface, up: Array, point: Array, T_any_camera: Array) -> float:
    """How much a plane is like a floor: its area, weighted by how steadily it lies below; else 0.

    Seen from a camera that turns about, the normals of walls turn and that of the floor stays:
    the mean of ``up`` in camera coordinates is long. It shows upwards in the image, or sideways
    in that of a rolled camera, rather than along the optical axis.
    """
    height = float(point @ up)
    above = T_any_camera[:, :3, 3] @ up - height
    offset = surface.points @ up - height
    if not HEIGHTS_M[0] < np.quantile(above, LOWEST) < HEIGHTS_M[1] or above.min() < 0:
        return 0.0
    support = float(_members(surface, up, height).mean())
    if support < MIN_SUPPORT or (offset < -BELOW_M).mean() > MAX_BELOW:
        return 0.0
    in_camera = (np.swapaxes(T_any_camera[:, :3, :3], 1, 2) @ up).mean(0)
    steady = float(np.hypot(in_camera[0], in_camera[1]))
    if np.linalg.norm(in_camera) < STEADY or steady < UPRIGHT:
        return 0.0
    upwards = (1 - in_camera[1] / steady) / 2
    return float(support * steady**4 * upwards)
