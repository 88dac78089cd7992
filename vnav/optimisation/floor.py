"""The floor: the plane that much surface lies on, hardly any under, seen upright by all cameras."""

from dataclasses import dataclass, replace

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
UPRIGHT = 0.25  # of it across the optical axis, unless the cameras look straight down or up
HYPOTHESES = 500
COS_SAME = float(np.cos(np.deg2rad(15)))
AUTO = "auto"
SIDES = {  # unit vectors in camera coordinates
    "top": (0.0, -1.0, 0.0),
    "bottom": (0.0, 1.0, 0.0),
    "left": (-1.0, 0.0, 0.0),
    "right": (1.0, 0.0, 0.0),
    "behind": (0.0, 0.0, -1.0),  # the camera looks down
    "ahead": (0.0, 0.0, 1.0),
}
TURNS_ABOUT = 0.5  # length of the mean of an axis that turns about another
STANDING_M = (0.15, 1.6)  # above a floor: the tops of what stands on it
FEW_STAND = 0.002  # share of the surface, that says nothing
FAR_MORE = 4.0  # times as much of it, that makes a warning
UPSIDE_DOWN = 0.01  # how likely a camera is to hang that way, if a plane is seen above it and below
ONE_PLANE = 0.3  # the same of one that sees a single plane: it hangs that way, or looks up


@dataclass(frozen=True)
class Floor:
    """A floor: ``up`` (3,), its height along it in metres, and which points of a surface lie on it.

    ``less_stands``: far less stands on it than on what is above, if that were the floor.
    """

    up: Array
    height: float
    members: NDArray[np.bool_]
    less_stands: bool = False


def find_floor(
    surface: Surface, T_any_camera: Array, rng: np.random.Generator, up_in_images: str = AUTO
) -> Floor | None:
    """The floor in a ``surface`` that cameras (N, 4, 4) saw; None where none is convincing.

    ``up_in_images``: the side of the images that is up. By itself it is the top, or behind a camera
    that looks straight down and turns about. Where the images leave open which of two planes is
    the floor, what stands on them tells: for a camera on its side, or one that sees a single plane.
    """
    if not len(surface.points):
        return None
    drawn = rng.integers(0, len(surface.points), HYPOTHESES)
    steady, likely = _upright(surface.normals[drawn], T_any_camera, up_in_images)
    scores = steady**4
    scores[steady > 0] *= [_area(surface, int(k), T_any_camera) for k in drawn[steady > 0]]
    best = int((scores * likely).argmax())
    if not scores[best]:
        return None
    floor = _plane(surface, int(drawn[best]))
    if up_in_images != AUTO:
        return floor if likely[best] > 0.5 else None
    scores[surface.normals[drawn] @ floor.up > -COS_SAME] = 0
    ceiling = _plane(surface, int(drawn[scores.argmax()])) if scores.any() else None
    return _floor_of(surface, floor, ceiling, float(likely[best]))


def _floor_of(surface: Surface, floor: Floor, ceiling: Floor | None, likely: float) -> Floor | None:
    """Which of two planes that face each other is the floor; the first, if likely by the images."""
    least = UPSIDE_DOWN if ceiling else ONE_PLANE
    likely = float(np.clip(likely, least, 1 - least))
    stands, stands_above = _standing(surface, floor), _standing(surface, ceiling)
    if likely * stands < (1 - likely) * stands_above:
        return ceiling
    return replace(floor, less_stands=stands_above > FAR_MORE * stands)


def _upright(normals: Array, T_any_camera: Array, up_in_images: str) -> tuple[Array, Array]:
    """How steady normals (H, 3) are in the images (H,), 0 if not at all, and how likely up (H,).

    Seen from a camera that turns about, the normals of walls turn and that of the floor stays:
    the mean in camera coordinates is long. It lies across the optical axis, unless up is along it.
    """
    in_camera = normals @ T_any_camera[:, :3, :3].mean(0)
    up = up_in_camera(T_any_camera, up_in_images)
    seen = in_camera if up[2] else in_camera * (1, 1, 0)
    steady = np.linalg.norm(seen, axis=1)
    likely = (1 + seen @ up / np.maximum(steady, UPRIGHT)) / 2
    steady[(np.linalg.norm(in_camera, axis=1) < STEADY) | (steady < UPRIGHT)] = 0
    return steady, np.maximum(likely, UPSIDE_DOWN)


def up_in_camera(T_any_camera: Array, up_in_images: str) -> Array:
    """The side (3,) of cameras (N, 4, 4) that is up: the named one, or what is most common."""
    if up_in_images != AUTO:
        return np.array(SIDES[up_in_images])
    x, y, z = np.linalg.norm(T_any_camera[:, :3, :3].mean(0), axis=0)
    return np.array(SIDES["behind" if z > STEADY and max(x, y) < TURNS_ABOUT else "top"])


def _plane(surface: Surface, k: int) -> Floor:
    """The plane through many points about that through one of them, seen from the same side."""
    normal = surface.normals[k]
    up, height = normal, float(surface.points[k] @ normal)
    for _ in range(5):
        members = _members(surface, up, height)
        centre = surface.points[members].mean(0)
        up = np.linalg.svd(surface.points[members] - centre, full_matrices=False)[2][2]
        up = up if up @ normal > 0 else -up
        height = float(centre @ up)
    return Floor(up, height, _members(surface, up, height))


def _members(surface: Surface, up: Array, height: float) -> NDArray[np.bool_]:
    near = np.abs(surface.points @ up - height) < BAND_M
    return np.asarray(near & (surface.normals @ up > COS_SAME))


def _standing(surface: Surface, plane: Floor | None) -> float:
    """How much there is of level tops above a plane, as of what stands on a floor."""
    if plane is None:
        return FEW_STAND
    above = surface.points @ plane.up - plane.height
    within = (above > STANDING_M[0]) & (above < STANDING_M[1])
    return FEW_STAND + float((within & (surface.normals @ plane.up > COS_SAME)).mean())


def _area(surface: Surface, k: int, T_any_camera: Array) -> float:
    """Share of the surface that lies on the plane through a point; 0 where it is no floor."""
    up, point = surface.normals[k], surface.points[k]
    height = float(point @ up)
    above = T_any_camera[:, :3, 3] @ up - height
    if not HEIGHTS_M[0] < np.quantile(above, LOWEST) < HEIGHTS_M[1] or above.min() < 0:
        return 0.0
    support = float(_members(surface, up, height).mean())
    offset = surface.points @ up - height
    if support < MIN_SUPPORT or (offset < -BELOW_M).mean() > MAX_BELOW:
        return 0.0
    return support
