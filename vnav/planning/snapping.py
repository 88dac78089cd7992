"""Start and goal snapped to the costmap: moved to the nearest cells that the robot can be in."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.core.frame import Rejected
from vnav.core.grid import OCCUPIED, UNKNOWN
from vnav.planning.costmap import Costmap

Point = tuple[float, float]  # x, y in the world, metres
Yaws = tuple[float | None, float | None]  # at the start and at the goal, None where it is open
_BATCH = 4096  # straight lines that are checked together, so that they take little memory


@dataclass(frozen=True)
class SnappedPoint:
    """A start or goal: the point that was asked for and the one that is used, ``moved_m`` away."""

    asked: Point
    snapped: Point
    moved_m: float
    cell: tuple[int, int]


@dataclass(frozen=True)
class _Candidates:
    """Cells (M, 2) that could stand for a point, nearest first, and how far off they are (M,)."""

    point: Point
    cells: NDArray[np.intp]
    moved_m: NDArray[np.float64]


def snap_start_and_goal(
    costmap: Costmap,
    start: Point,
    goal: Point,
    tolerance_m: float,
    yaws: Yaws = (None, None),
    *,
    leaves: bool = False,
) -> tuple[SnappedPoint, SnappedPoint] | Rejected:
    """The cells nearest to start and goal, both in one region; Rejected where there are none.

    A point is moved by ``tolerance_m`` at most, and only where the robot cannot be at it or cannot
    drive between the two; to the centre of its cell also where that makes a difference to one-ways
    or to a footprint. A footprint can stand there with the yaw that ``yaws`` has for it. Where it
    ``leaves`` the goal again, it is one where it can turn all round, if one is near enough. On the
    straight way to its new place a point may leave the obstacle, the inflated space or the unknown
    that it lies in, but never enters an obstacle, nor inflated space from outside: a goal is not
    moved through a wall, nor through a gap too narrow for the robot.
    """
    candidates = []
    for name, point, yaw_rad in zip(("start", "goal"), (start, goal), yaws, strict=True):
        near = _candidates(costmap, point, tolerance_m, costmap.standable(yaw_rad))
        if leaves and name == "goal":
            roomy = _candidates(costmap, point, tolerance_m, costmap.turnable())
            near = roomy if len(roomy.cells) else near
        if not len(near.cells):
            return Rejected(_no_cell_reason(costmap, name, point, tolerance_m))
        candidates.append(near)
    nearest = [_nearest_in_region(costmap, near) for near in candidates]
    common = sorted(nearest[0].keys() & nearest[1].keys())
    if not common:
        return Rejected(_separate_reason(costmap, candidates))
    moved = [
        sum(c.moved_m[n[region]] for c, n in zip(candidates, nearest, strict=True))
        for region in common
    ]
    region = common[int(np.argmin(moved))]
    snapped = [_snapped(costmap, c, n[region]) for c, n in zip(candidates, nearest, strict=True)]
    return snapped[0], snapped[1]


def reachable_cells(costmap: Costmap, point: Point, tolerance_m: float) -> NDArray[np.intp]:
    """The cells (M, 2) that a start or goal may be moved to, nearest first."""
    return _candidates(costmap, point, tolerance_m, costmap.standable(None)).cells


def _candidates(
    costmap: Costmap, point: Point, tolerance_m: float, wanted: NDArray[np.bool_]
) -> _Candidates:
    grid = costmap.grid
    cells = np.argwhere(wanted)
    moved_m = np.hypot(*(grid.centres_of(cells) - point).T)
    here = (cells == grid.cells_at(point)).all(1)
    moved_m[here] *= ~costmap.are_exact(cells[here])
    near = np.flatnonzero((moved_m <= tolerance_m) | here)
    near = near[np.argsort(moved_m[near], kind="stable")]
    cells, moved_m = cells[near], moved_m[near]
    parts = np.array_split(grid.centres_of(cells), 1 + len(cells) // _BATCH)
    straight = np.concatenate([_line_leads_out(costmap, point, part) for part in parts])
    return _Candidates(point, cells[straight], moved_m[straight])


def _line_leads_out(
    costmap: Costmap, point: Point, centres: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Whether straight lines (M,) from a point to others (M, 2) only lead out of obstacles."""
    grid = costmap.grid
    farthest_m = np.hypot(*(centres - point).T).max(initial=0)
    parts = np.linspace(0, 1, 2 + int(2 * farthest_m / grid.resolution_m))
    lines = grid.cells_at(point + parts[:, None] * (centres[:, None] - point))
    inside, (rows, columns) = grid.contains(lines), np.moveaxis(lines, -1, 0)
    rows, columns = np.where(inside, rows, 0), np.where(inside, columns, 0)
    states = np.where(inside, grid.cells[rows, columns], UNKNOWN)
    depth = np.where(states == OCCUPIED, 2, costmap.inflated[rows, columns] & inside)
    unseen_or_solid = (states == UNKNOWN) | (states == OCCUPIED)  # an obstacle's inside is unseen
    depth[np.logical_and.accumulate(unseen_or_solid, axis=1)] = 2
    return np.asarray((np.diff(depth, axis=1) <= 0).all(1))


def _nearest_in_region(costmap: Costmap, candidates: _Candidates) -> dict[int, int]:
    """For each region, the first of the candidates that lies in it."""
    rows, columns = candidates.cells.T
    regions, first = np.unique(costmap.regions[rows, columns], return_index=True)
    return dict(zip(regions.tolist(), first.tolist(), strict=True))


def _snapped(costmap: Costmap, candidates: _Candidates, index: int) -> SnappedPoint:
    moved_m, (row, column) = float(candidates.moved_m[index]), candidates.cells[index].tolist()
    x, y = costmap.grid.centres_of((row, column)).tolist()
    return SnappedPoint(
        candidates.point, (x, y) if moved_m else candidates.point, moved_m, (row, column)
    )


def _no_cell_reason(costmap: Costmap, name: str, point: Point, tolerance_m: float) -> str:
    """Why there is no cell for a point."""
    cells = np.argwhere(costmap.costs > 0)
    if not len(cells):
        return "the robot fits nowhere on this grid"
    away_m = np.hypot(*(costmap.grid.centres_of(cells) - point).T).min()
    beyond = " and beyond an obstacle" if away_m <= tolerance_m else ""
    return (
        f"the {name} ({point[0]:.2f}, {point[1]:.2f}) {_state_text(costmap, point)};"
        f" the nearest cell the robot can be in is {away_m:.2f} m away{beyond},"
        f" the tolerance is {tolerance_m:g} m"
    )


def _state_text(costmap: Costmap, point: Point) -> str:
    grid = costmap.grid
    row, column = grid.cells_at(point).tolist()
    if not grid.contains((row, column)):
        return "lies outside the grid"
    if grid.cells[row, column] == OCCUPIED:
        return "lies in an obstacle"
    if costmap.inflated[row, column]:
        return f"is {max(costmap.clearance_m[row, column], 0):.2f} m from an obstacle"
    if costmap.fits is not None and grid.cells[row, column] != UNKNOWN:
        return "is too near obstacles for the footprint"
    return "lies in unknown space"


def _separate_reason(costmap: Costmap, candidates: list[_Candidates]) -> str:
    areas = []
    for near in candidates:
        region = costmap.regions[tuple(near.cells[0])]
        areas.append((costmap.regions == region).sum() * costmap.grid.resolution_m**2)
    return f"start and goal lie in separate regions, of {areas[0]:.1f} and {areas[1]:.1f} m2"
