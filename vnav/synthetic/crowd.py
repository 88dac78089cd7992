"""Ways of people through a scene, chosen so that they cover a wanted share of a camera's view.

A way is the best chain of places by dynamic programming: what the walker covers there together
with the others comes as near as can be to what is wanted at that time. A walk never pauses, a
pause never moves.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vnav.errors import CaptureError
from vnav.synthetic.places import MOVES, Net
from vnav.synthetic.sights import Sight, covered
from vnav.synthetic.strolls import SIT, WALK, Stroll, stroll

Array = NDArray[np.float64]
SLOW = np.hypot(*MOVES.T) < 1.5  # into and out of a pause
HEADING_RAD = np.arctan2(*MOVES.T)
CAMERA_M = 0.8  # from the camera
APART_M = 0.5  # from each other
TOO_NEAR = 10.0  # cost, in squared shares of the view
TURN = 0.004  # cost of a right angle
SHARP_RAD = 1.9  # turns beyond take two steps
ROUNDS = 3  # in which each walker is planned again, given the others


def draw_strolls(
    net: Net,
    sights: Sequence[Sight],
    camera_xy: Array,
    wanted: Array,
    schedules: Sequence[list[int]],
) -> list[Stroll]:
    """One way for each schedule of K - 1 intervals.

    ``sights`` (K) and ``camera_xy`` (K, 2) of the camera; ``wanted`` (K,): the share of the view
    that all together should cover.
    """
    ways: dict[int, NDArray[np.intp]] = {}
    for turn in range(ROUNDS * len(schedules)):
        k = turn % len(schedules)
        others = [way for other, way in ways.items() if other != k]
        part = wanted * min(1.0, (turn + 1) / len(schedules))
        seen = [covered(sight, [way[t] for way in others]) for t, sight in enumerate(sights)]
        cost = np.array([(theirs + own - part[t]) ** 2 for t, (theirs, own) in enumerate(seen)])
        cost += _crowding(net, camera_xy, CAMERA_M)
        cost += sum(_crowding(net, net.xy[*way.T], APART_M) for way in others)
        ways[k] = best_way(net, schedules[k], cost)
    return [
        stroll(net.xy[*ways[k].T], kinds, net.seats[*ways[k].T])
        for k, kinds in enumerate(schedules)
    ]


def best_way(net: Net, kinds: list[int], cost: Array) -> NDArray[np.intp]:
    """Rows and columns (K, 2) of the cheapest way; ``cost`` (K, R, C) of being at a node."""
    total = np.where(net.free, cost[0], np.inf) + np.zeros((len(MOVES), 1, 1))
    came_from = []
    turns = _turn_costs()
    for k, kind in enumerate(kinds):
        if kind == WALK:
            pause_before = k > 0 and kinds[k - 1] != WALK
            pause_after = k + 1 < len(kinds) and kinds[k + 1] != WALK
            options = total[:, None] + (0 * turns if pause_before else turns)
            before = options.argmin(0)
            total = _moved(net, options.min(0))
            total[~SLOW if pause_before or pause_after else []] = np.inf
        else:
            before = np.broadcast_to(np.arange(len(MOVES))[:, None, None], total.shape)
            total = np.where(np.isnan(net.seats[..., 0]), np.inf, total) if kind == SIT else total
        total = total + cost[k + 1]
        came_from.append(before)
    return _traced(total, came_from, kinds)


def _moved(net: Net, total: Array) -> Array:
    """Costs (M, R, C) at the nodes that each move leads to, infinite where its way is blocked."""
    found = np.full_like(total, np.inf)
    rows, columns = net.free.shape
    for m, (dy, dx) in enumerate(MOVES):
        to = slice(max(dy, 0), rows + min(dy, 0)), slice(max(dx, 0), columns + min(dx, 0))
        start = slice(max(-dy, 0), rows - max(dy, 0)), slice(max(-dx, 0), columns - max(dx, 0))
        found[m][to] = total[m][start]
    return np.where(net.reached, found, np.inf)


def _traced(total: Array, came_from: list[NDArray[np.intp]], kinds: list[int]) -> NDArray[np.intp]:
    """Back from the cheapest end; CaptureError where there is no way at all."""
    if not np.isfinite(total).any():
        raise CaptureError(
            "expected walkers to find a way through the scene, found that no seat is reached in"
            " time; ask for fewer walkers, or a scene with seats in the open"
        )
    move, *node = np.unravel_index(int(total.argmin()), total.shape)
    at = np.array(node)
    nodes = [at]
    for before, kind in zip(reversed(came_from), reversed(kinds), strict=True):
        if kind == WALK:
            at = at - MOVES[move]
            move = before[move, *at]
        nodes.append(at)
    return np.array(nodes[::-1])


def _turn_costs() -> Array:
    """Of each move followed by each: (M, M, 1, 1)."""
    turn = np.abs((HEADING_RAD[:, None] - HEADING_RAD + np.pi) % (2 * np.pi) - np.pi)
    cost = TURN * (1 - np.cos(turn)) + TOO_NEAR * (turn > SHARP_RAD)
    return np.asarray(cost[..., None, None])


def _crowding(net: Net, way: Array, apart_m: float) -> Array:
    """Cost (K, R, C) of nodes near to a way (K, 2), then, a step before or a step after."""
    steps = np.arange(len(way))
    ats = [way[np.clip(steps + shift, 0, len(way) - 1), None, None] for shift in (-1, 0, 1)]
    near = [np.linalg.norm(net.xy - at, axis=-1) < apart_m for at in ats]
    return np.asarray(TOO_NEAR * np.sum(near, 0))
