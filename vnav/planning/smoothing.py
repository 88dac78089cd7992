"""A route over cells made a path that a robot can follow."""

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Array
from vnav.planning.astar import UNIT
from vnav.planning.lanes import Lanes, is_against

Costs = NDArray[np.int32]

_LONGEST = 200  # cells of a route that one straight segment may replace
_ROUNDS = 3  # of corner cutting
_SAME = 1e-9  # what differs by less is the same


def smooth(points: Array, costs: Costs, lanes: Lanes) -> Array:
    """A path through fewer points with rounder corners, that costs no more and is no longer.

    Straight segments replace parts of the route, those that together cost the least; then corners
    are cut (Chaikin 1974) where that costs no more. What a segment costs is the integral of the
    cells' costs along it, as for the moves of A*; it never touches a blocked cell, nor passes
    between two that meet at a corner. None goes against a one-way.

    Parameters
    ----------
    points
        (K, 2) column and row in cells, that of a cell's centre ending in one half; each segment
        between two in succession is passable.
    costs
        (rows, columns) as for `astar.search`.
    """
    path: Array = points[_chain(points, costs, lanes)]
    for _ in range(_ROUNDS):
        path = _cut_corners(path, costs, lanes)
    return path


@compiled
def _is_shut(costs: Costs, lanes: Lanes, row: int, column: int, towards: Array) -> bool:
    """Whether a cell is blocked, or a movement (2,) goes against a one-way there."""
    is_blocked = costs[row, column] == 0
    return bool(is_blocked or is_against(lanes.headings[lanes.sets[row, column]], towards))


@compiled
def segment_cost(costs: Costs, lanes: Lanes, a: Array, b: Array) -> float:
    """What the straight way between points (2,) costs, infinite where it touches a blocked cell.

    So it is where it goes against a one-way. In cells of cost 1. Source of the walk through the
    cells: Amanatides, Woo 1987.
    """
    cell, towards, step = np.floor(a), b - a, np.sign(b - a)
    crossing, between = np.full(2, np.inf), np.full(2, np.inf)  # cell borders, in parts of the way
    for k in range(2):
        if towards[k] != 0:
            crossing[k] = (cell[k] + (step[k] > 0) - a[k]) / towards[k]
            between[k] = 1 / abs(towards[k])
    total, at = 0.0, 0.0
    while True:
        column, row = int(cell[0]), int(cell[1])
        if _is_shut(costs, lanes, row, column, towards):
            return np.inf
        reached = min(crossing[0], crossing[1], 1.0)
        total += (reached - at) * costs[row, column]
        if reached >= 1:
            return float(total * np.hypot(towards[0], towards[1]) / UNIT)
        if abs(crossing[0] - crossing[1]) < _SAME:
            along, across = column + int(step[0]), row + int(step[1])
            if _is_shut(costs, lanes, row, along, towards):
                return np.inf
            if _is_shut(costs, lanes, across, column, towards):
                return np.inf
        for k in range(2):
            if crossing[k] - reached < _SAME:
                cell[k] += step[k]
                crossing[k] += between[k]
        at = reached


@compiled
def _chain(points: Array, costs: Costs, lanes: Lanes) -> NDArray[np.int64]:
    """Which points to go straight between so that the whole costs least; of equals, the fewest."""
    n = len(points)
    cost, origin = np.full(n, np.inf), np.zeros(n, np.int64)
    cost[0] = 0
    for j in range(1, n):
        for i in range(max(0, j - _LONGEST), j):
            through = cost[i] + segment_cost(costs, lanes, points[i], points[j])
            if through < cost[j] - _SAME:
                cost[j], origin[j] = through, i
    kept = [n - 1]
    while kept[-1] > 0:
        kept.append(origin[kept[-1]])
    return np.array(kept[::-1])


def _cut_corners(path: Array, costs: Costs, lanes: Lanes) -> Array:
    """Each corner replaced by the segment from a quarter before it to a quarter after it."""
    rounder = [path[0]]
    for before, corner, after in zip(path, path[1:], path[2:], strict=False):
        a, b = corner + (before - corner) / 4, corner + (after - corner) / 4
        along = segment_cost(costs, lanes, a, corner) + segment_cost(costs, lanes, corner, b)
        rounder += [a, b] if segment_cost(costs, lanes, a, b) <= along + _SAME else [corner]
    return np.array([*rounder, path[-1]])
