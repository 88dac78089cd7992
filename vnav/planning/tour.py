"""The order in which several places are visited at the least cost."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from vnav.core.arrays import Array
from vnav.core.frame import Rejected
from vnav.planning.costmap import Costmap
from vnav.planning.routes import snapped_route
from vnav.planning.snapping import Point

MOST = 10  # places: time and memory double with each


def best_order(
    costs: Costmap, start: Point, visits: Sequence[Point], goal: Point
) -> tuple[int, ...]:
    """Rows of ``visits``, which all lie between start and goal, as they are driven to.

    The cost between two is that of the route of A*. Where there is no way over all of them, the
    order is some one.
    """
    points = (start, *visits, goal)
    between = np.zeros((len(points), len(points)))
    for i, j in combinations(range(len(points)), 2):
        between[i, j] = between[j, i] = _cost(costs, points[i], points[j])
        if not costs.is_reversible:
            between[j, i] = _cost(costs, points[j], points[i])
    return tuple(row - 1 for row in cheapest_order(between))


def cheapest_order(between: Array) -> tuple[int, ...]:
    """All rows but the first and the last, as they are passed on the cheapest way between these.

    ``between`` (N, N): cost from each to each. Exact, by the best way over each subset to each of
    its members (Held, Karp 1962).
    """
    inner = range(1, len(between) - 1)
    best: dict[tuple[frozenset[int], int], tuple[float, tuple[int, ...]]]
    best = {(frozenset([k]), k): (between[0, k], (k,)) for k in inner}
    for subset in (frozenset(c) for size in inner[1:] for c in combinations(inner, size)):
        for last in subset:
            before = subset - {last}
            ways = ((best[before, k], between[k, last]) for k in before)
            best[subset, last] = min((way[0] + step, (*way[1], last)) for way, step in ways)
    ends = [best[frozenset(inner), k] for k in inner]
    return min(((cost + between[order[-1], -1], order) for cost, order in ends), default=(0, ()))[1]


def _cost(costs: Costmap, a: Point, b: Point) -> float:
    """Of the way from one point to another, infinite where there is none."""
    found = snapped_route(costs, (a, b))
    return np.inf if isinstance(found, Rejected) else found[1].cost
