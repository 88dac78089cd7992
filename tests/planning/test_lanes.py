"""One-ways: no path moves against one, whatever the cells, the smoothing and the visits."""

import dataclasses
from collections.abc import Sequence
from itertools import pairwise, permutations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from vnav.config import PlanConfig
from vnav.core.frame import Rejected
from vnav.core.grid import FREE, OCCUPIED, Grid
from vnav.core.places import OneWay, Zones
from vnav.planning.astar import UNIT, Route, search
from vnav.planning.costmap import Costmap, costmap
from vnav.planning.lanes import Lanes, barred_moves, lanes
from vnav.planning.planner import Plan, plan_path
from vnav.planning.routes import snapped_route
from vnav.planning.smoothing import segment_cost
from vnav.planning.tour import best_order

Array = NDArray[np.float64]
CONFIG = PlanConfig(robot_radius_m=0.1, clearance_weight=0.0)
EAST, NORTH, WEST = np.arange(3) * np.pi / 2


def _rooms(*doors: int) -> Grid:
    """Two rooms of 2 m x 3 m; doors of 0.6 m through the wall between them begin at those rows."""
    cells = np.full((60, 84), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = cells[:, 40:44] = OCCUPIED
    for row in doors:
        cells[row : row + 12, 40:44] = FREE
    return Grid((0.0, 0.0), 0.05, cells)


def _door(row: int, heading_rad: float) -> OneWay:
    """A one-way over a door and a little of both rooms."""
    low, high = row * 0.05 - 0.1, row * 0.05 + 0.7
    return OneWay(np.array([(1.8, low), (2.4, low), (2.4, high), (1.8, high)]), heading_rad)


def _costs(grid: Grid, **one_way: OneWay) -> Costmap:
    return costmap(grid, 0.0, CONFIG, Zones(one_way=one_way))


LEFT, RIGHT = (1.0, 0.8), (3.2, 0.8)
TWO_DOORS = _rooms(10, 40)


def test_a_door_that_leads_the_other_way_is_gone_round() -> None:
    costs = _costs(TWO_DOORS, near=_door(10, EAST))
    there, back = plan_path(costs, LEFT, RIGHT), plan_path(costs, RIGHT, LEFT)
    assert isinstance(there, Plan)
    assert isinstance(back, Plan)
    assert there.length_m == pytest.approx(2.2)
    assert back.poses[np.abs(back.poses[:, 0] - 2.1).argmin(), 1] > 2.0  # by the far door


def test_a_one_way_that_bars_the_way_is_named() -> None:
    costs = _costs(_rooms(10), gate=_door(10, WEST))
    refused = plan_path(costs, LEFT, RIGHT)
    assert isinstance(refused, Rejected)
    assert refused.reason == "no path joins start and goal; the one-way 'gate' is in the way"
    assert isinstance(plan_path(costs, RIGHT, LEFT), Plan)


def test_several_that_bar_the_way_together_are_named() -> None:
    zones = Zones(
        {"rug": _door(40, 0).corners_m}, {"gate": _door(10, WEST), "aside": _door(25, EAST)}
    )
    barred = costmap(_rooms(10), 0.0, CONFIG, Zones(zones.keep_out, {"gate": _door(10, WEST)}))
    refused = plan_path(barred, LEFT, RIGHT)
    assert isinstance(refused, Rejected)
    assert refused.reason.endswith("; the one-way 'gate' is in the way")
    refused = plan_path(costmap(TWO_DOORS, 0.0, CONFIG, zones), LEFT, RIGHT)
    assert isinstance(refused, Rejected)  # either is enough
    assert refused.reason.endswith("; the keep-out 'rug' is in the way")
    both = Zones({"rug": _door(10, 0).corners_m}, {"gate": _door(10, WEST)})
    refused = plan_path(costmap(_rooms(10), 0.0, CONFIG, both), LEFT, RIGHT)
    assert isinstance(refused, Rejected)
    assert refused.reason.endswith("; several keep-outs and one-ways are in the way: rug, gate")


def test_sideways_is_not_against_a_one_way() -> None:
    floor = OneWay(np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 3.0), (0.0, 3.0)]), NORTH)
    costs = _costs(_rooms(), floor=floor)
    along = plan_path(costs, (0.325, 1.525), (1.625, 1.525))
    assert isinstance(along, Plan)
    assert along.length_m == pytest.approx(1.3)
    assert isinstance(plan_path(costs, (1.0, 1.525), (1.0, 1.475)), Rejected)


def test_a_line_of_cells_that_meet_at_corners_is_not_slipped_through() -> None:
    """A one-way without area, oblique to the cells, which leads square to its long side."""
    square_to = float(np.arctan2(2.88, 1.88) + np.pi / 2)
    thin = OneWay(np.array([(0.06, 0.06), (1.94, 2.94), (1.94, 2.94)]), square_to)
    costs = _costs(_rooms(), thin=thin)
    assert isinstance(plan_path(costs, (1.6, 0.6), (0.4, 2.4)), Plan)
    assert isinstance(plan_path(costs, (0.4, 2.4), (1.6, 0.6)), Rejected)


def _random_zones(seed: int) -> tuple[Grid, Zones]:
    """Blocks and triangles that overlap, each of which leads some way."""
    rng = np.random.default_rng(seed)
    cells = np.full((40, 40), FREE, np.uint8)
    for row, column in rng.integers(0, 37, (10, 2)):
        cells[row : row + 3, column : column + 3] = OCCUPIED
    corners, headings = rng.uniform(0, 2, (4, 3, 2)), rng.uniform(-np.pi, np.pi, 4)
    named = {f"{k}": OneWay(corners[k], float(headings[k])) for k in range(4)}
    return Grid((0.0, 0.0), 0.05, cells), Zones(one_way=named)


def _against(grid: Grid, zones: Zones, path: Array) -> float:
    """The farthest that a path moves against a one-way, in parts of its length there."""
    most = 0.0
    for zone in zones.one_way.values():
        inside = grid.touched(zone.corners_m)
        ahead = np.array([np.cos(zone.heading_rad), np.sin(zone.heading_rad)])
        for a, b in zip(path[:-1], path[1:], strict=True):
            # between its ends, which may lie on a border
            points = a + np.linspace(0.001, 0.999, 200)[:, None] * (b - a)
            if inside[tuple(grid.cells_at(points).T)].any():
                most = max(most, -float((b - a) @ ahead) / float(np.hypot(*(b - a))))
    return most


@pytest.mark.parametrize("seed", range(12))
def test_no_path_moves_against_a_one_way(seed: int) -> None:
    grid, zones = _random_zones(seed)
    rng = np.random.default_rng(seed)
    found = 0
    for smooth in (True, False):
        costs = costmap(grid, 0.0, dataclasses.replace(CONFIG, smooth=smooth), zones)
        ends = grid.centres_of(rng.permutation(np.argwhere(costs.costs > 0))[:12]) + 0.012
        for start, goal in zip(ends[:6].tolist(), ends[6:].tolist(), strict=True):
            plan = plan_path(costs, tuple(start), tuple(goal))
            if isinstance(plan, Plan):
                found += 1
                # the path's points are written to 1e-16 m, 5 cm apart at most and 1 mm at least
                assert _against(grid, zones, plan.poses[:, :2]) < 1e-9
    assert found


def _directed(costs: Costmap) -> coo_matrix:
    """Every legal move, told one by one: no cell of the square that it spans is led against it."""
    rows, columns = costs.costs.shape
    i, j, weight = [], [], []
    for r, c in np.argwhere(costs.costs > 0).tolist():
        for dr, dc in ((a, b) for a in (-1, 0, 1) for b in (-1, 0, 1) if (a, b) != (0, 0)):
            if not (0 <= r + dr < rows and 0 <= c + dc < columns):
                continue
            square = {(r, c), (r + dr, c), (r, c + dc), (r + dr, c + dc)}
            ahead = np.concatenate(
                [costs.lanes.headings[costs.lanes.sets[cell]] for cell in square]
            )
            if any(costs.costs[cell] == 0 for cell in square) or (ahead @ (dc, dr) < -1e-9).any():
                continue
            step = int(costs.costs[r, c]) + int(costs.costs[r + dr, c + dc])
            i.append(r * columns + c)
            j.append((r + dr) * columns + c + dc)
            weight.append((step * 181 + 64) // 128 if dr and dc else step)
    return coo_matrix((weight, (i, j)), shape=(costs.costs.size,) * 2)


@pytest.mark.parametrize("seed", range(6))
def test_a_route_costs_what_an_independent_dijkstra_over_directed_moves_says(seed: int) -> None:
    grid, zones = _random_zones(seed)
    costs = costmap(grid, 0.0, dataclasses.replace(CONFIG, clearance_weight=2.0), zones)
    barred, rng = barred_moves(costs.lanes), np.random.default_rng(seed)
    graph, cells = _directed(costs), np.argwhere(costs.costs > 0)
    for _ in range(5):
        start, goal = (tuple(cells[k].tolist()) for k in rng.integers(0, len(cells), 2))
        least = dijkstra(graph, indices=start[0] * 40 + start[1])[goal[0] * 40 + goal[1]]
        route = search(costs.costs, start, goal, barred)
        if isinstance(route, Route):
            assert route.cost == least / (2 * UNIT)
        else:
            assert not np.isfinite(least)


def test_without_one_ways_no_move_is_barred() -> None:
    assert barred_moves(lanes(_rooms(), ())) is None


def test_a_point_in_a_one_way_goes_to_the_centre_of_its_cell() -> None:
    costs = _costs(TWO_DOORS, near=_door(10, EAST))
    plan = plan_path(costs, (2.11, 0.81), RIGHT)
    assert isinstance(plan, Plan)
    assert plan.start.snapped == pytest.approx((2.125, 0.825))
    assert plan.start.moved_m == pytest.approx(np.hypot(0.015, 0.015))


def test_a_line_past_the_corner_of_a_one_way_goes_against_it_too() -> None:
    costs, sets = np.full((2, 2), UNIT, np.int32), np.zeros((2, 2), np.int32)
    sets[0, 1] = 1
    ways = Lanes(sets, np.array([[(0.0, 0.0)], [(-1.0, 0.0)]]))
    low, high = np.array([0.5, 0.5]), np.array([1.5, 1.5])
    assert segment_cost(costs, ways, low, high) == np.inf
    assert segment_cost(costs, ways, high, low) == pytest.approx(np.sqrt(2))


def _ring() -> Costmap:
    """A way round a block, up by the left and down by the right."""
    cells = np.full((60, 60), FREE, np.uint8)
    cells[20:40, 20:40] = OCCUPIED
    west, east = (np.array([(x, 0.0), (x + 1, 0), (x + 1, 3), (x, 3)]) for x in (0.0, 2.0))
    both = {"up": OneWay(west, NORTH), "down": OneWay(east, -NORTH)}
    return costmap(Grid((0.0, 0.0), 0.05, cells), 0.0, CONFIG, Zones(one_way=both))


@pytest.mark.parametrize("seed", range(4))
def test_no_other_order_of_visits_is_cheaper(seed: int) -> None:
    """What counts is the way there, and not the way back."""
    costs, rng = _ring(), np.random.default_rng(seed)
    cells = rng.permutation(np.argwhere(costs.costs > 0))[:5]
    points = [(x, y) for x, y in costs.grid.centres_of(cells).tolist()]

    def cost(order: Sequence[int]) -> float:
        over = [points[0], *(points[1 + k] for k in order), points[-1]]
        found = [snapped_route(costs, leg) for leg in pairwise(over)]
        return sum(np.inf if isinstance(leg, Rejected) else leg[1].cost for leg in found)

    least = min(map(cost, permutations(range(3))))
    assert np.isfinite(least)
    assert cost(best_order(costs, points[0], points[1:-1], points[-1])) == pytest.approx(least)
