"""A* on a grid: claim 5, 3.2 to 3.5.

8-connected, corners not cut, optimal on the cost it declares. Costs are whole numbers: no rounding
depends on the machine, and a queue of buckets, one for each value of F (Dial 1969), does what a
heap would in half the time. A bucket is a doubly linked list through the cells, so that a cell
that gets better moves to another bucket and none is queued twice.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.frame import Rejected

NO_WAY = Rejected("no path joins start and goal")
UNIT = 256  # what a cell of cost 1 costs
Cell = tuple[int, int]  # row, column
Flat = NDArray[np.int32]  # a value or two for each cell, row by row
Barred = NDArray[np.uint16]  # moves of each cell, or nothing
Whole = Any  # an integer, or numpy's
ToGoal = tuple[int, int, int, int]  # row, column, least cost of a straight and a diagonal move

_START = -(2**31) + 1  # g, the cost from start, is counted from here: so 0 means not reached
_NEXT, _PREVIOUS = 0, 1  # columns of the links between cells of a bucket
_MOVES = ((-1, 0), (0, -1), (0, 1), (1, 0), (-1, -1), (-1, 1), (1, -1), (1, 1))


@dataclass(frozen=True)
class Route:
    """Cells (K, 2) as row, column from start to goal, and how many cells were expanded for it.

    ``cost``: its length in cells, each half of a move times the cost of the cell it lies in.
    """

    cells: NDArray[np.int32]
    cost: float
    expanded: int


def search(
    costs: NDArray[np.int32], start: Cell, goal: Cell, barred: NDArray[np.uint16] | None = None
) -> Route | Rejected:
    """The cheapest route between two passable cells, Rejected where none joins them.

    ``costs`` (rows, columns) int32 says what a cell costs, in units of 1 / UNIT; 0 is blocked. A
    straight move costs the mean of its two cells. A diagonal one costs 181/128 of that, rounded
    (the square root of 2, less 0.01 %), and the two cells beside it must be passable. F is the cost
    from start plus what the rest would cost on an empty grid of the least cost; along a route it
    never falls (the heuristic is consistent), so no cell is expanded twice. A route may cost up to
    four million cells of cost 1. ``barred`` (rows, columns): moves that are not made, as
    `lanes.barred_moves` gives them. ValueError where start or goal is blocked.
    """
    if not (costs[start] > 0 and costs[goal] > 0):
        raise ValueError(f"expected passable cells, found {start} or {goal} blocked")
    width = costs.shape[1] + 2
    first, last = (int((r + 1) * width + c + 1) for r, c in (start, goal))
    padded = np.pad(costs, 1).ravel()
    moves = np.zeros(0, np.uint16) if barred is None else np.pad(barred, 1).ravel()
    g, links = np.zeros(padded.size, np.int32), np.empty((padded.size, 2), np.int32)
    expanded = _search(g, links, padded, moves, width, (first, last))
    if g[last] == 0:
        return NO_WAY
    nodes = _backtracked(g, padded, moves, width, first, last)
    cells = np.stack([nodes // width, nodes % width], 1).astype(np.int32) - 1
    return Route(cells, (int(g[last]) - _START) / (2 * UNIT), expanded)


@compiled
def _extremes(costs: Flat) -> tuple[int, int]:
    """Least and greatest cost of a passable cell."""
    least, most = np.int32(2**31 - 1), np.int32(0)
    for cost in costs:
        least = min(least, cost if cost > 0 else np.int32(2**31 - 1))
        most = max(most, cost)
    return int(least), int(most)


@compiled
def _search(
    g: Flat, links: Flat, costs: Flat, barred: Barred, width: int, ends: tuple[int, int]
) -> int:
    """Enter the cost from start of every cell that may lead to goal; how many were expanded.

    ``g``, ``costs`` and ``barred`` (N,) are padded grids row by row, ``links`` (N, 2) room for the
    queue.
    """
    (start, goal), (least, most) = ends, _extremes(costs)
    heads = np.zeros(_power_of_two_above(2 * _across(2 * most)), np.int32)
    to_goal = (goal // width, goal % width, 2 * least, _across(2 * least))
    f = _START + _heuristic(start // width, start % width, to_goal)
    g[start] = _START
    _push(links, heads, start, f)
    queued, expanded, best = 1, 0, np.int64(g[goal])
    while queued > 0 and f < best:
        node = np.int64(heads[np.uint64(f & (len(heads) - 1))])
        if node == 0:
            f += 1
            continue
        _pop(links, heads, f)
        queued -= 1
        expanded += 1
        row, column = node // width, node % width
        so_far, cost = np.int64(g[np.uint64(node)]), np.int64(costs[np.uint64(node)])
        up, down = costs[np.uint64(node - width)] > 0, costs[np.uint64(node + width)] > 0
        left, right = costs[np.uint64(node - 1)] > 0, costs[np.uint64(node + 1)] > 0
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                other = node + dr * width + dc
                known = np.int64(g[np.uint64(other)])
                step = cost + costs[np.uint64(other)]
                if known <= so_far or step == cost or _is_barred(barred, node, dr, dc):
                    continue
                if dr != 0 and dc != 0:
                    if not ((up if dr < 0 else down) and (left if dc < 0 else right)):
                        continue
                    step = _across(step)
                h = _heuristic(row + dr, column + dc, to_goal)
                if so_far + step >= known or so_far + step + h >= best:
                    continue
                if known < 0:
                    _remove(links, heads, other, known + h)
                    queued -= 1
                g[np.uint64(other)] = so_far + step
                _push(links, heads, other, so_far + step + h)
                queued += 1
                if other == goal:
                    best = so_far + step
    return expanded


@compiled
def _is_barred(barred: Barred, node: Whole, dr: int, dc: int) -> bool:
    """Whether a move from a cell is not made; ``barred`` is empty where all are."""
    return bool(len(barred) > 0 and barred[node] >> (3 * dr + dc + 4) & 1)


@compiled
def _across(straight: int) -> int:
    """What a diagonal move costs where a straight one costs this much."""
    return (straight * 181 + 64) >> 7


@compiled
def _heuristic(row: Whole, column: Whole, to_goal: ToGoal) -> Whole:
    goal_row, goal_column, straight, diagonal = to_goal
    down, along = abs(row - goal_row), abs(column - goal_column)
    both = min(down, along)
    return straight * (max(down, along) - both) + diagonal * both


@compiled
def _push(links: Flat, heads: Flat, node: Whole, f: Whole) -> None:
    """Put a cell at the head of the bucket of F, whose number wraps round; node 0 is no cell."""
    bucket = np.uint64(f & (len(heads) - 1))
    links[np.uint64(node), _NEXT] = heads[bucket]
    links[np.uint64(node), _PREVIOUS] = 0
    links[np.uint64(heads[bucket]), _PREVIOUS] = node
    heads[bucket] = node


@compiled
def _pop(links: Flat, heads: Flat, f: int) -> None:
    bucket = np.uint64(f & (len(heads) - 1))
    heads[bucket] = links[np.uint64(heads[bucket]), _NEXT]
    links[np.uint64(heads[bucket]), _PREVIOUS] = 0


@compiled
def _remove(links: Flat, heads: Flat, node: Whole, f: Whole) -> None:
    after, before = links[np.uint64(node), _NEXT], links[np.uint64(node), _PREVIOUS]
    if before == 0:
        heads[np.uint64(f & (len(heads) - 1))] = after
    else:
        links[np.uint64(before), _NEXT] = after
    links[np.uint64(after), _PREVIOUS] = before


@compiled
def _power_of_two_above(value: int) -> int:
    power = 1
    while power <= value:
        power *= 2
    return power


@compiled
def _backtracked(
    g: Flat, costs: Flat, barred: Barred, width: int, start: int, goal: int
) -> NDArray[np.int64]:
    """Nodes from start to goal, found backwards: which neighbour did each cost come from."""
    nodes = [goal]
    while nodes[-1] != start:
        nodes.append(_origin(g, costs, barred, width, nodes[-1]))
    return np.array(nodes[::-1])


@compiled
def _origin(g: Flat, costs: Flat, barred: Barred, width: int, node: int) -> int:
    for dr, dc in _MOVES:
        other = node + dr * width + dc
        step = np.int64(costs[node]) + costs[other]
        if _is_barred(barred, other, -dr, -dc):
            continue
        if dr != 0 and dc != 0:
            step = _across(step)
            if costs[node + dr * width] == 0 or costs[node + dc] == 0:
                continue
        if costs[other] > 0 and g[other] < 0 and g[other] + step == g[node]:
            return other
    return node
