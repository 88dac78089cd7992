"""Where a robot that is no disc may stand, drive and turn, for 16 yaws at each cell's centre."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Array
from vnav.planning.footprint import Footprint

_QUARTER = ((1, 0), (2, 1), (1, 1), (1, 2))
DIRECTIONS = tuple(  # columns and rows, in the order of their angles
    way
    for turned in range(4)
    for x, y in _QUARTER
    for way in [((x, y), (-y, x), (-x, -y), (y, -x))[turned]]
)
ANGLES = np.arctan2(*np.array(DIRECTIONS, float).T[::-1]) % (2 * np.pi)
ALL = (1 << len(DIRECTIONS)) - 1  # the bits of all of them
_AHEAD = np.array(DIRECTIONS)
_FARTHEST = np.sqrt(5)  # cells that one of them leads

Cells = NDArray[np.bool_]  # (rows, columns)
Masks = NDArray[np.uint16]  # (rows, columns), a bit for each direction


@dataclass(frozen=True)
class Fits:
    """What a footprint may do at each cell's centre; bit k stands for direction k.

    ``stands``: with that yaw; ``drives``: that way, to the centre of the cell there; ``turns``:
    between that yaw and the next.
    """

    stands: Masks
    drives: Masks
    turns: Masks

    def regions(self) -> NDArray[np.int32]:
        """Equal above 0 where cells are joined by driving, forth or back, and turning; else 0.

        A cell belongs to the largest of the regions that it is in with one yaw or another.
        """
        return np.asarray(_regions(self.stands, self.drives, self.turns))


def fits(footprint: Footprint, occupied: Cells, distance: Array, passable: Cells) -> Fits:
    """What it may do at the passable cells; ``distance``: cells to the nearest occupied one."""
    here, angles = np.zeros(2), np.append(ANGLES, ANGLES[0] + 2 * np.pi)
    goes = [footprint.driving(here, np.array(way, float)) for way in DIRECTIONS]
    turned = [footprint.turning(here, a, b) for a, b in zip(angles, angles[1:], strict=False)]
    near = passable & (distance < footprint.reach + _FARTHEST)

    def masks(sweeps: list[Array]) -> Masks:
        bits = np.where(passable, np.uint16(ALL), np.uint16(0))
        for k, poses in enumerate(sweeps):
            bits[footprint.hits(occupied, near, poses)] &= np.uint16(ALL ^ 1 << k)
        return bits

    return Fits(masks([poses[:1] for poses in goes]), masks(goes), masks(turned))


@compiled
def _root(parent: NDArray[np.int64], node: int) -> int:
    """The member that stands for a node's set; ``parent`` (N,) leads there, and is shortened."""
    while parent[node] != node:
        parent[node] = parent[parent[node]]
        node = parent[node]
    return node


@compiled
def _regions(stands: Masks, drives: Masks, turns: Masks) -> NDArray[np.int32]:
    parent = _joined(stands, drives, turns)
    sizes, regions = np.zeros(len(parent), np.int64), np.zeros(stands.shape, np.int32)
    for state in range(len(parent)):
        sizes[_root(parent, state)] += 1
    for cell in range(stands.size):
        largest = 0
        for k in range(len(_AHEAD)):
            found = _root(parent, cell * len(_AHEAD) + k)
            if stands.flat[cell] >> k & 1 and sizes[found] > largest:
                largest = sizes[found]
                regions.flat[cell] = found + 1
    return regions


@compiled
def _joined(stands: Masks, drives: Masks, turns: Masks) -> NDArray[np.int64]:
    """Sets of states, a cell and a yaw each, that moves join; see `_root`."""
    (rows, columns), count = stands.shape, len(_AHEAD)
    parent = np.arange(rows * columns * count)
    for state in range(len(parent)):
        cell, k = state // count, state % count
        r, c = cell // columns, cell % columns
        i, j = r + _AHEAD[k, 1], c + _AHEAD[k, 0]
        inside = 0 <= i < rows and 0 <= j < columns
        if inside and drives[r, c] >> k & 1 and stands[i, j] >> k & 1:
            parent[_root(parent, (i * columns + j) * count + k)] = _root(parent, state)
        if turns[r, c] >> k & 1:
            parent[_root(parent, cell * count + (k + 1) % count)] = _root(parent, state)
    return parent
