"""A* over cells and headings, for a robot that is no disc: claim 5, 3.2 to 3.5, with its footprint.

A state is a cell's centre and one of 16 yaws. The robot drives straight on to the centre of the
next cell that way, or turns on the spot to the next yaw. What is free is looked up, see `Fits`.
"""

import heapq

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Array
from vnav.core.frame import Rejected
from vnav.planning.astar import NO_WAY, UNIT, Cell, Route, Whole
from vnav.planning.costmap import Costmap
from vnav.planning.fits import ALL, ANGLES, DIRECTIONS, Fits
from vnav.planning.lanes import Lanes
from vnav.planning.smoothing import Costs, segment_cost
from vnav.planning.snapping import Yaws

TURN = 0.25  # cells that a turn to the next yaw costs as much as
_AHEAD = np.array(DIRECTIONS, float)


def search_headed(
    costs: Costmap, fits: Fits, start: Cell, goal: Cell, yaws: Yaws
) -> Route | Rejected:
    """The cheapest route of those moves between two cells, Rejected where none joins them."""
    first, last = (_bits(costs, cell, yaw) for cell, yaw in zip((start, goal), yaws, strict=True))
    free = np.stack([fits.drives, fits.turns])
    ends = np.array([*start, first & fits.stands[start], *goal, last], np.int64)
    states, cost, expanded = _search(costs.costs, costs.lanes, free, ends)
    if not len(states):
        return NO_WAY
    cells = np.stack(np.divmod(states // len(ANGLES), costs.costs.shape[1]), 1).astype(np.int32)
    kept = np.append(True, (np.diff(cells, axis=0) != 0).any(1))
    return Route(cells[kept], cost, expanded)


def _bits(costs: Costmap, cell: Cell, yaw_rad: float | None) -> int:
    """The yaws next to a given one from which a robot in a cell can turn to it; all, for none."""
    if yaw_rad is None or costs.footprint is None:
        return ALL
    at = np.array(cell[::-1]) + 0.5
    after = int(np.searchsorted(ANGLES, yaw_rad % (2 * np.pi), "right"))
    beside = {(after - 1) % len(ANGLES), after % len(ANGLES)}
    turns = {k: costs.footprint.turning(at, ANGLES[k], yaw_rad) for k in beside}
    return sum(1 << k for k, turn in turns.items() if costs.first_hit(turn) < 0)


@compiled
def _search(
    costs: Costs, lanes: Lanes, free: NDArray[np.uint16], ends: NDArray[np.int64]
) -> tuple[NDArray[np.int64], float, int]:
    """States from start to goal, none where there is no way; its cost, and how many were expanded.

    ``free`` (2, rows, columns): where it drives and turns; ``ends`` (6,): row, column and the bits
    of the yaws of start and goal.
    """
    (rows, columns), turned = costs.shape, len(_AHEAD)
    g = np.full(rows * columns * turned, np.inf)
    origin = np.full(len(g), -1, np.int64)
    least = _least(costs)
    goal = np.array([ends[4] + 0.5, ends[3] + 0.5])
    queue: list[tuple[float, Whole]] = [(0.0, np.int64(-1))]
    for k in range(turned):
        if ends[2] >> k & 1:
            state = (ends[0] * columns + ends[1]) * turned + k
            g[state] = 0.0
            queue.append((0.0, state))
    expanded = 0
    while len(queue) > 0:
        f, state = heapq.heappop(queue)
        if state < 0:
            continue
        k, cell = state % turned, state // turned
        r, c = cell // columns, cell % columns
        if r == ends[3] and c == ends[4] and ends[5] >> k & 1:
            return _traced(origin, state), g[state], expanded
        if f > g[state] + _to_go(r, c, goal, least) + 1e-9:
            continue  # it was reached at less since
        expanded += 1
        for move in range(3):
            step, i, j, yaw = _step(costs, lanes, free, (r, c, k), move)
            other = (i * columns + j) * turned + yaw
            if step < np.inf and g[state] + step < g[other]:
                g[other], origin[other] = g[state] + step, state
                heapq.heappush(queue, (g[other] + _to_go(i, j, goal, least), other))
    return np.zeros(0, np.int64), np.inf, expanded


@compiled
def _step(
    costs: Costs,
    lanes: Lanes,
    free: NDArray[np.uint16],
    state: tuple[int, int, int],
    move: int,
) -> tuple[float, int, int, int]:
    """What driving on (0) or turning to either side (1, 2) costs, infinite where it cannot be.

    Then the row, column and yaw of the state that it leads to.
    """
    r, c, k = state
    if move == 0 and free[0, r, c] >> k & 1:
        at = np.array([c + 0.5, r + 0.5])
        cost = segment_cost(costs, lanes, at, at + _AHEAD[k])
        return cost, r + int(_AHEAD[k, 1]), c + int(_AHEAD[k, 0]), k
    before = (k - 1) % len(_AHEAD)
    if move == 1 and free[1, r, c] >> k & 1:
        return TURN, r, c, (k + 1) % len(_AHEAD)
    if move == 2 and free[1, r, c] >> before & 1:
        return TURN, r, c, before
    return np.inf, r, c, k


@compiled
def _least(costs: Costs) -> float:
    """Cost of the cheapest passable cell."""
    least = np.inf
    for cost in costs.flat:
        if cost > 0:
            least = min(least, float(cost))
    return least


@compiled
def _to_go(row: int, column: int, goal: Array, least: float) -> float:
    """What the straight way to the goal costs where all cells cost the least."""
    return float(np.hypot(column + 0.5 - goal[0], row + 0.5 - goal[1]) * least / UNIT)


@compiled
def _traced(origin: NDArray[np.int64], state: int) -> NDArray[np.int64]:
    states = [state]
    while origin[states[-1]] >= 0:
        states.append(origin[states[-1]])
    return np.array(states[::-1])
