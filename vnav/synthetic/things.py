"""Things that move as a whole before a camera, as in Bonn's recordings of boxes: no limbs tell.

Each moves about the place where a tour begins, seen from there: x ahead, y to the left, z up.
Source of the kinds: Palazzolo et al. 2019, "ReFusion: 3D reconstruction in dynamic environments
for RGB-D cameras exploiting residuals", the Bonn RGB-D dynamic dataset.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.synthetic.clothes import CLOTHES
from vnav.synthetic.raycast import Rectangles
from vnav.synthetic.scene import SMALL_TEXEL_M, Box, Face, faces_of, rectangles_of
from vnav.synthetic.textures import texture

PRINT = "printed"
STILL_S = 1e-3  # between two poses that tell whether something moves
PANEL_M, PANEL_AHEAD_M, PANEL_REACH_M, PANEL_S = (0.06, 1.2, 1.9), 1.9, 1.0, 9.0
BOX_M, BOX_AHEAD_M, BOX_UP_M, BOX_REACH_M = (0.35, 1.15, 1.15), 0.85, 0.5, 1.8
CART_M, CART_NEAREST_M, CART_WAY_M, CART_S = (0.9, 0.7, 1.0), 1.0, 2.0, 10.0
CRATE_M, CRATE_AHEAD_M, CRATE_UP_M, CRATE_FROM_M = (0.5, 0.6, 0.6), 2.0, 0.9, 2.2
Way = Callable[[float], tuple[float, float, float, float]]  # x, y, z and yaw at a time


@dataclass(frozen=True)
class Thing:
    """A box of a size, its bottom where ``way`` says, as seen from a place: x, y, yaw.

    A place of an upper storey has the floor's z after them.
    """

    size_m: tuple[float, float, float]
    way: Way
    place: Array
    seed: int

    def at(self, t_s: float) -> Rectangles:
        """Its faces in the world at a time."""
        return rectangles_of(self._faces).moved(self._pose(t_s))

    def images(self) -> list[NDArray[np.uint8]]:
        """A texture for each face, in their order; all have the same colours."""
        return [
            texture(CLOTHES[PRINT], face.size_m, SMALL_TEXEL_M, *self._rngs(number))
            for number, face in enumerate(self._faces)
        ]

    def moves_at(self, t_s: float) -> bool:
        """Whether it moves."""
        return not np.allclose(self.way(t_s), self.way(t_s + STILL_S), atol=1e-6)

    @cached_property
    def _faces(self) -> list[Face]:
        middle = (0.0, 0.0, self.size_m[2] / 2)
        return faces_of(Box(middle, self.size_m, 0.0, PRINT), 0)

    def _rngs(self, number: int) -> tuple[np.random.Generator, np.random.Generator]:
        return np.random.default_rng([self.seed, 8]), np.random.default_rng([self.seed, 9, number])

    def _pose(self, t_s: float) -> Array:
        x, y, yaw, *floor = self.place.tolist()
        place = se3.make(se3.exp_so3([0, 0, yaw]), np.array([x, y, sum(floor)]))
        *there, turned = self.way(t_s)
        return np.asarray(place @ se3.make(se3.exp_so3([0, 0, turned]), np.array(there)))


def _panel(t_s: float) -> tuple[float, float, float, float]:
    """A partition slides to and fro across the view, at an even speed."""
    return PANEL_AHEAD_M, PANEL_REACH_M * _to_and_fro(t_s / PANEL_S), 0.05, 0.0


def _box(t_s: float) -> tuple[float, float, float, float]:
    """A box is carried past so closely that it fills the view, and hangs there for a while."""
    times_s, sides = [0, 1.5, 3, 4.5, 8], [-1, -0.03, 0.03, 1, 1]
    side = BOX_REACH_M * float(np.interp(t_s % times_s[-1], times_s, sides))
    return BOX_AHEAD_M, side, BOX_UP_M, 0.3 * side


def _cart(t_s: float) -> tuple[float, float, float, float]:
    """A cart is pushed away from the camera, and back."""
    ahead_m = CART_NEAREST_M + CART_WAY_M * (1 - abs(_to_and_fro(t_s / CART_S)))
    return ahead_m, 0.25, 0.0, 0.0


def _crate(t_s: float) -> tuple[float, float, float, float]:
    """A crate is carried in from the side and set down, where it stays."""
    left, above = (float(np.clip(u, 0, 1)) for u in ((5 - t_s) / 3, (5.3 - t_s) / 0.8))
    return CRATE_AHEAD_M, CRATE_FROM_M * left, CRATE_UP_M * above, left


def _to_and_fro(periods: float) -> float:
    """From 1 to -1 and back in each period, evenly."""
    return float(2 * abs(2 * (periods % 1) - 1) - 1)


THINGS: dict[str, tuple[tuple[float, float, float], Way]] = {
    "panel": (PANEL_M, _panel),
    "box": (BOX_M, _box),
    "cart": (CART_M, _cart),
    "crate": (CRATE_M, _crate),
}
"""By name: how large a thing is, and its way."""


def thing_before(name: str, place: Array, seed: int) -> Thing:
    """One of `THINGS` before a place: x, y, yaw, and the floor's z where that is not 0."""
    size_m, way = THINGS[name]
    return Thing(size_m, way, np.asarray(place, float), seed)
