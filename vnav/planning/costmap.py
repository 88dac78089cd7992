"""What driving over each cell costs a robot, and where it cannot be: inflated obstacles."""

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.config import PlanConfig
from vnav.core.arrays import Array
from vnav.core.grid import OCCUPIED, UNKNOWN, WALKED, Grid
from vnav.planning.astar import UNIT


@dataclass(frozen=True)
class Costmap:
    """A grid as a robot of some size sees it; all arrays (rows, columns).

    Parameters
    ----------
    grid
        What stands where; without walked cells where these are not allowed.
    clearance_m
        From a cell's centre to the nearest occupied cell, infinite where there is none: the
        distance to its centre less half a cell's diagonal.
    inflated
        Whether clearance is less than the robot needs, its radius and the map's uncertainty.
    costs
        int32, `astar.UNIT` far from obstacles, more near them; 0 where the robot cannot be.
    regions
        int32, equal where the robot can drive from one cell to the other; 0 where it cannot be.
    """

    grid: Grid
    clearance_m: Array
    inflated: NDArray[np.bool_]
    costs: NDArray[np.int32]
    regions: NDArray[np.int32]


def costmap(grid: Grid, uncertainty_m: float, config: PlanConfig) -> Costmap:
    """Inflate what is occupied, and declare what the rest costs.

    A metre costs ``1 + clearance_weight`` where the robot just fits, falling to 1 in a straight
    line over ``clearance_range_m`` more clearance. Walked cells cost ``walked_cost`` times as much
    as free ones; without ``allow_walked`` they are unknown. Unknown cells are blocked; where
    ``allow_unknown`` is set they cost ``unknown_cost`` times as much as free ones.
    """
    if not config.allow_walked:
        cells = np.where(grid.cells == WALKED, np.uint8(UNKNOWN), grid.cells)
        grid = dataclasses.replace(grid, cells=cells)
    clearance_m = grid.resolution_m * (_distances(grid.cells == OCCUPIED) - np.sqrt(0.5))
    spare_m = clearance_m - (config.robot_radius_m + uncertainty_m)
    inflated = spare_m < 0
    unknown, walked = grid.cells == UNKNOWN, grid.cells == WALKED
    unseen = np.select([unknown, walked], [config.unknown_cost, config.walked_cost], 1.0)
    nearness = np.clip(1 - spare_m / config.clearance_range_m, 0, 1)
    cost = (1 + config.clearance_weight * nearness) * unseen
    blocked = inflated | (unknown & (not config.allow_unknown))
    costs = np.where(blocked, 0, np.rint(UNIT * cost)).astype(np.int32)
    return Costmap(grid, clearance_m, inflated, costs, _regions(~blocked))


def _distances(occupied: NDArray[np.bool_]) -> Array:
    """Distances between centres in cells, exact (Felzenszwalb, Huttenlocher 2012)."""
    return np.asarray(np.sqrt(_squared_distances(occupied)))


@compiled
def _squared_distances(occupied: NDArray[np.bool_]) -> Array:
    """First along each column, then along each row."""
    rows, columns = occupied.shape
    along, squared = np.full((rows, columns), np.inf), np.full((rows, columns), np.inf)
    for c in range(columns):
        for forth in (True, False):
            away = np.inf
            for k in range(rows):
                r = k if forth else rows - 1 - k
                away = 0.0 if occupied[r, c] else away + 1
                along[r, c] = min(along[r, c], away * away)
    lowest, begins = np.zeros(columns, np.int64), np.zeros(columns)
    for r in range(rows):
        _lower_envelope(along[r], lowest, begins, squared[r])
    return squared


@compiled
def _lower_envelope(
    heights: Array, lowest: NDArray[np.int64], begins: Array, result: Array
) -> None:
    """Enter the least of the parabolas ``heights[c] + (x - c)**2`` at each x.

    ``lowest`` and ``begins`` are room for which of them is the least from where on.
    """
    count = 0
    for c in range(len(heights)):
        if heights[c] == np.inf:
            continue
        begin = -np.inf
        while count > 0:
            last = lowest[count - 1]
            begin = (heights[c] - heights[last] + c * c - last * last) / (2 * (c - last))
            if begin > begins[count - 1]:
                break
            begin = -np.inf
            count -= 1
        lowest[count] = c
        begins[count] = begin
        count += 1
    k = 0
    for x in range(len(heights) if count > 0 else 0):
        while k + 1 < count and begins[k + 1] < x:
            k += 1
        away = x - lowest[k]
        result[x] = heights[lowest[k]] + away * away


@compiled
def _regions(passable: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Numbers from 1 for cells joined by their sides, as moves that cut no corner join them."""
    rows, columns = passable.shape
    regions = np.zeros((rows, columns), np.int32)
    stack = np.empty(rows * columns, np.int64)
    count = 0
    for first in range(rows * columns):
        if not passable[first // columns, first % columns] or regions.flat[first] > 0:
            continue
        count += 1
        regions[first // columns, first % columns] = count
        stack[0], height = first, 1
        while height > 0:
            height -= 1
            r, c = stack[height] // columns, stack[height] % columns
            for k in range(4):
                i, j = r + (1, -1, 0, 0)[k], c + (0, 0, 1, -1)[k]
                if 0 <= i < rows and 0 <= j < columns and passable[i, j] and regions[i, j] == 0:
                    regions[i, j] = count
                    stack[height] = i * columns + j
                    height += 1
    return regions
