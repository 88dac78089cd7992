"""Which way cells may be crossed: what one-ways leave open."""

from collections.abc import Collection
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Array
from vnav.core.grid import Grid
from vnav.core.places import OneWay

MOVES = tuple((dr, dc) for dr in (-1, 0, 1) for dc in (-1, 0, 1))  # move k leads so far
_ROUNDING = 1e-9  # of a unit vector: square to a heading is not against it


class Lanes(NamedTuple):
    """The headings that no movement through a cell goes against.

    ``sets`` (rows, columns) int32: a row of ``headings`` (K, Z, 2), which holds unit vectors, x and
    y; where a cell has fewer than Z, the others are 0.
    """

    sets: NDArray[np.int32]
    headings: Array

    def are_in(self, cells: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Which of the cells (M, 2) lie in a one-way."""
        are_led = np.asarray(self.headings.any((1, 2)))
        return np.asarray(are_led[self.sets[tuple(cells.T)]])


def lanes(grid: Grid, one_ways: Collection[OneWay]) -> Lanes:
    """Every cell that a one-way holds or touches is crossed as that leads."""
    if not one_ways:
        return Lanes(np.zeros(grid.cells.shape, np.int32), np.zeros((1, 1, 2)))
    inside = np.stack([grid.touched(each.corners_m).ravel() for each in one_ways], 1)
    patterns, sets = np.unique(inside, axis=0, return_inverse=True)
    ahead = np.array([each.ahead for each in one_ways])
    return Lanes(sets.reshape(grid.cells.shape).astype(np.int32), patterns[:, :, None] * ahead)


def barred_moves(open_ways: Lanes) -> NDArray[np.uint16] | None:
    """Bit k where move k of `MOVES` goes against a one-way; None where none does anywhere.

    In the cell that it leaves (rows, columns), that it enters, or, for a diagonal one, one of the
    two beside it, whose corner it touches.
    """
    if not open_ways.headings.any():
        return None
    towards = np.array(MOVES, float)[:, ::-1]
    against = (open_ways.headings @ towards.T < -_ROUNDING).any(1)  # (K, 9)
    here = np.pad(against[open_ways.sets], ((1, 1), (1, 1), (0, 0)))
    rows, columns = open_ways.sets.shape
    barred = np.zeros((rows, columns), np.uint16)
    for k, (dr, dc) in enumerate(MOVES):
        for r, c in {(1, 1), (1 + dr, 1), (1, 1 + dc), (1 + dr, 1 + dc)}:
            barred |= here[r : r + rows, c : c + columns, k].astype(np.uint16) << k
    return barred


@compiled
def is_against(headings: Array, towards: Array) -> bool:
    """Whether a movement (2,) goes against one of some headings (Z, 2)."""
    length = np.hypot(towards[0], towards[1])
    for k in range(len(headings)):
        if headings[k, 0] * towards[0] + headings[k, 1] * towards[1] < -_ROUNDING * length:
            return True
    return False
