"""What driving over each cell costs a robot, and where it cannot be: inflated obstacles."""

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.config import PlanConfig
from vnav.config.outline import corners_of
from vnav.core.arrays import Array
from vnav.core.grid import OCCUPIED, UNKNOWN, WALKED, Grid
from vnav.core.places import Zones
from vnav.planning.astar import UNIT
from vnav.planning.distances import distances
from vnav.planning.fits import ALL, Fits, fits
from vnav.planning.footprint import STEP_M, STEPS, Footprint
from vnav.planning.lanes import Lanes, barred_moves, lanes

EVERYWHERE = Zones()  # may be driven, any way


@dataclass(frozen=True)
class Costmap:
    """A grid as a robot of some size sees it; all arrays (rows, columns).

    Parameters
    ----------
    seen, uncertainty_m, config, zones
        What it was made of.
    grid
        What stands where, keep-outs too; without walked cells where these are not allowed.
    clearance_m
        From a cell's centre to the nearest occupied cell, infinite where there is none: the
        distance to its centre less half a cell's diagonal.
    inflated
        Whether clearance is less than the robot needs, its radius and the map's uncertainty; of a
        footprint, the radius of the largest disc about its origin that it holds.
    costs
        int32, `astar.UNIT` far from obstacles, more near them; 0 where the robot cannot be.
    regions
        int32, equal where the robot can drive from one cell to the other, were there no one-ways;
        0 where it cannot be. That of a footprint is told as if it could drive back.
    lanes
        Which way cells may be crossed.
    footprint, fits
        The robot's outline, where it is no disc, and what it may do where.
    """

    seen: Grid
    uncertainty_m: float
    config: PlanConfig
    zones: Zones
    grid: Grid
    clearance_m: Array
    inflated: NDArray[np.bool_]
    costs: NDArray[np.int32]
    regions: NDArray[np.int32]
    lanes: Lanes
    footprint: Footprint | None
    fits: Fits | None

    def changed(self, zones: Zones | None = None, **config: Any) -> "Costmap":
        """The same floor with other zones, or for another robot."""
        kept = self.zones if zones is None else zones
        other = dataclasses.replace(self.config, **config)
        return costmap(self.seen, self.uncertainty_m, other, kept)

    @cached_property
    def barred(self) -> NDArray[np.uint16] | None:
        """Moves that go against a one-way, as `lanes.barred_moves` gives them."""
        return barred_moves(self.lanes)

    @property
    def is_reversible(self) -> bool:
        """Whether every way may be driven backwards, for directions do not matter."""
        return self.footprint is None and not self.lanes.headings.any()

    def first_hit(self, poses: Array) -> int:
        """The first of the poses (S, 3) in cells at which the footprint hits something, else -1."""
        occupied = self.grid.cells == OCCUPIED
        return -1 if self.footprint is None else self.footprint.first_hit(occupied, poses)

    def standable(self, yaw_rad: float | None) -> NDArray[np.bool_]:
        """Where the robot can be, with a yaw, where one is given."""
        passable = self.costs > 0
        if self.footprint is None or yaw_rad is None:
            return passable
        standing = np.array([[0, 0, yaw_rad]])
        return passable & ~self.footprint.hits(self.grid.cells == OCCUPIED, passable, standing)

    def turnable(self) -> NDArray[np.bool_]:
        """Where the robot can be and turn all round on the spot."""
        return (self.costs > 0) & (self.fits is None or self.fits.turns == ALL)

    def are_exact(self, cells: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Where in a cell (M, 2) a robot stands makes no difference: no one-way, room to turn."""
        exact = ~self.lanes.are_in(cells)
        if self.footprint is not None:
            away = self.clearance_m[tuple(cells.T)] / self.grid.resolution_m - np.sqrt(0.5)
            room_m = self.uncertainty_m / self.grid.resolution_m + self.footprint.step
            exact &= away > self.footprint.circumscribed + room_m
        return exact


def costmap(
    seen: Grid, uncertainty_m: float, config: PlanConfig, zones: Zones = EVERYWHERE
) -> Costmap:
    """Inflate what is occupied, and declare what the rest costs.

    A metre costs ``1 + clearance_weight`` where the robot just fits, falling to 1 in a straight
    line over ``clearance_range_m`` more clearance; a footprint just fits where it can turn. Walked
    cells cost ``walked_cost`` times as much as free ones; without ``allow_walked`` they are
    unknown. Unknown cells are blocked; where ``allow_unknown`` is set they cost ``unknown_cost``
    times as much as free ones. What a keep-out touches is occupied.
    """
    grid = seen.blocked(zones.keep_out.values())
    if not config.allow_walked:
        cells = np.where(grid.cells == WALKED, np.uint8(UNKNOWN), grid.cells)
        grid = dataclasses.replace(grid, cells=cells)
    occupied = grid.cells == OCCUPIED
    distance = distances(occupied)
    clearance_m = grid.resolution_m * (distance - np.sqrt(0.5))
    footprint = _footprint(config, grid.resolution_m, uncertainty_m)
    inner_m, outer_m = radii_m(config)
    inflated = clearance_m < inner_m + uncertainty_m
    spare_m = clearance_m - (outer_m + uncertainty_m)
    unknown, walked = grid.cells == UNKNOWN, grid.cells == WALKED
    unseen = np.select([unknown, walked], [config.unknown_cost, config.walked_cost], 1.0)
    nearness = np.clip(1 - spare_m / config.clearance_range_m, 0, 1)
    cost = (1 + config.clearance_weight * nearness) * unseen
    passable = ~(inflated | (unknown & (not config.allow_unknown)))
    may = fits(footprint, occupied, distance, passable) if footprint else None
    passable = passable if may is None else may.stands > 0
    costs = np.where(passable, np.rint(UNIT * cost), 0).astype(np.int32)
    made_of = (seen, uncertainty_m, config, zones, grid, clearance_m, inflated, costs)
    open_ways = lanes(grid, zones.one_way.values())
    regions = _regions(passable) if may is None else may.regions()
    return Costmap(*made_of, regions, open_ways, footprint, may)


def radii_m(config: PlanConfig) -> tuple[float, float]:
    """Of the largest disc about its origin that a robot holds, and the smallest that holds it."""
    footprint = _footprint(config, 1.0, 0.0)
    if footprint is None:
        return config.robot_radius_m, config.robot_radius_m
    return footprint.inscribed, footprint.circumscribed


def _footprint(config: PlanConfig, cell_m: float, uncertainty_m: float) -> Footprint | None:
    """The robot's outline in cells; None of a round robot."""
    if not config.footprint:
        return None
    corners_m = np.array(corners_of(config.footprint))
    step_m = max(STEP_M, float(np.hypot(*corners_m.T).max()) / STEPS)
    margin = uncertainty_m / cell_m + float(np.sqrt(0.5))
    return Footprint(corners_m / cell_m, margin, step_m / cell_m)


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
