"""The cheapest way from one place to another for whatever robot it is, and as it is followed."""

import dataclasses

import numpy as np

from vnav.core.arrays import Array
from vnav.core.frame import Rejected
from vnav.core.grid import Grid
from vnav.planning.astar import NO_WAY, Route, search
from vnav.planning.costmap import Costmap
from vnav.planning.headed import search_headed
from vnav.planning.smoothing import smooth
from vnav.planning.snapping import Point, SnappedPoint, Yaws, snap_start_and_goal

Ends = tuple[SnappedPoint, SnappedPoint]
_SAME = 1e-6  # cells: points so near are one


def snapped_route(
    costs: Costmap, points: tuple[Point, Point], yaws: Yaws = (None, None), *, leaves: bool = False
) -> tuple[Ends, Route] | Rejected:
    """The cheapest route between two points, and where these are moved to; Rejected says why not.

    ``yaws`` of the robot before and after it, where they are given, and whether it ``leaves`` the
    goal again, matter to a footprint only.
    """
    ends = snap_start_and_goal(costs, *points, costs.config.tolerance_m, yaws, leaves=leaves)
    if isinstance(ends, Rejected):
        return ends
    route = _cheapest(costs, ends, yaws)
    return route if isinstance(route, Rejected) else (ends, route)


def _cheapest(costs: Costmap, ends: Ends, yaws: Yaws) -> Route | Rejected:
    """The cheapest route between two cells, Rejected where there is none.

    That of a footprint is checked whole. Where a turn is free only the longer way round, its cell
    is closed to turns, and the search begins anew.
    """
    start, goal = (end.cell for end in ends)
    if costs.footprint is None or costs.fits is None:
        return search(costs.costs, start, goal, costs.barred)
    fits = dataclasses.replace(costs.fits, turns=costs.fits.turns.copy())
    while True:
        route = search_headed(costs, fits, start, goal, yaws)
        if isinstance(route, Rejected):
            return route
        poses = costs.footprint.following(_points(costs, route, ends), *yaws)
        hit = costs.first_hit(poses)
        if hit < 0:
            return route
        row, column = np.floor(poses[hit, 1::-1]).astype(int)
        if fits.turns[row, column] == 0:
            return NO_WAY
        fits.turns[row, column] = 0


def followed(costs: Costmap, route: Route, ends: Ends, yaws: Yaws) -> Array:
    """The points (K, 2) in metres of a route as a robot follows it, smoothed where that is asked.

    A footprint is off all obstacles all along, turns at the corners included.
    """
    points = _points(costs, route, ends)
    path = _eased(costs, points, yaws) if costs.config.smooth else points
    path = path * costs.grid.resolution_m + costs.grid.origin
    path[0], path[-1] = ends[0].snapped, ends[1].snapped
    return path


def _eased(costs: Costmap, points: Array, yaws: Yaws) -> Array:
    """Points (K, 2) in cells, smoothed; for a footprint in halves, as far as that does not hit."""
    if len(points) < 3:
        return points
    path = smooth(points, costs.costs, costs.lanes)
    if _is_clear(costs, path, yaws):
        return path
    middle = len(points) // 2
    first = _eased(costs, points[: middle + 1], (yaws[0], None))
    second = _eased(costs, points[middle:], (None, yaws[1]))
    path = np.concatenate([first, second[1:]])
    return path if _is_clear(costs, path, yaws) else points


def _is_clear(costs: Costmap, path: Array, yaws: Yaws) -> bool:
    return costs.footprint is None or costs.first_hit(costs.footprint.following(path, *yaws)) < 0


def _points(costs: Costmap, route: Route, ends: Ends) -> Array:
    """From one end over the cells' centres to the other, in cells, as column and row.

    Where directions matter, to a one-way or to a footprint, it passes the first and the last
    cell's centre, too.
    """
    start, goal = (_in_cells(costs.grid, end.snapped) for end in ends)
    centres = route.cells[:, ::-1] + 0.5
    if costs.is_reversible:
        return np.concatenate([[start], centres[1:-1], [goal]])
    before, after = (
        [end] if np.hypot(*(end - centre)) > _SAME else []
        for end, centre in ((start, centres[0]), (goal, centres[-1]))
    )
    return np.array([*before, *centres, *after])


def _in_cells(grid: Grid, point: tuple[float, float]) -> Array:
    """A point as column and row, counted from the corner of the first cell."""
    return (np.array(point) - grid.origin) / grid.resolution_m
