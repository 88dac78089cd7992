import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from vnav.core.frame import Rejected
from vnav.planning.astar import UNIT, Route, search

Costs = NDArray[np.int32]
OPEN, SHUT = UNIT, 0
CORNERS = [(0, 1), (1, 0), (1, 1), (1, -1)]  # moves, each with its reverse


def _random_costs(seed: int) -> Costs:
    """A grid of 20 to 40 cells a side, up to 45 % blocked, costs from 1 to 1, 2 or 11."""
    rng = np.random.default_rng(seed)
    shape = rng.integers(20, 40, 2)
    costs = UNIT + rng.integers(0, (1, UNIT, 10 * UNIT)[seed % 3], shape)
    costs[rng.random(shape) < rng.uniform(0, 0.45)] = SHUT
    return costs.astype(np.int32)


def _graph(costs: Costs) -> coo_matrix:
    """Every legal move between cells, weighted as `search` declares; built without loops of it."""
    numbers = np.arange(costs.size).reshape(costs.shape)
    moves = []
    for dr, dc in CORNERS:
        rows, columns = (
            slice(0, costs.shape[0] - dr),
            slice(max(0, -dc), costs.shape[1] - max(0, dc)),
        )
        there = slice(dr, None), slice(max(0, dc), costs.shape[1] + min(0, dc))
        a, b = costs[rows, columns].astype(np.int64), costs[there].astype(np.int64)
        legal, weight = (a > 0) & (b > 0), a + b
        if dr and dc:
            legal &= (costs[there[0], columns] > 0) & (costs[rows, there[1]] > 0)
            weight = (weight * 181 + 64) // 128
        moves.append((numbers[rows, columns][legal], numbers[there][legal], weight[legal]))
    i, j, weight = (np.concatenate(part) for part in zip(*moves, strict=True))
    return coo_matrix((weight, (i, j)), shape=(costs.size, costs.size))


def _cost_of(route: Route, costs: Costs) -> float:
    """The declared cost of a route, added up move by move."""
    total = 0
    for (r, c), (i, j) in zip(route.cells[:-1].tolist(), route.cells[1:].tolist(), strict=True):
        step = int(costs[r, c]) + int(costs[i, j])
        total += (step * 181 + 64) // 128 if r != i and c != j else step
    return total / (2 * UNIT)


def _found(costs: Costs, start: tuple[int, int], goal: tuple[int, int]) -> Route:
    route = search(costs, start, goal)
    assert isinstance(route, Route)
    return route


@pytest.mark.parametrize("seed", range(30))
def test_a_route_costs_what_an_independent_dijkstra_says(seed: int) -> None:
    costs, rng = _random_costs(seed), np.random.default_rng(seed)
    open_cells = np.argwhere(costs > 0)
    for k in range(5):
        start, goal = (tuple(open_cells[i].tolist()) for i in rng.integers(0, len(open_cells), 2))
        distances = dijkstra(_graph(costs), directed=False, indices=_number(start, costs))
        least = distances[_number(goal, costs)] / (2 * UNIT)
        route = search(costs, start, goal)
        if isinstance(route, Rejected):
            assert not np.isfinite(least)
        else:
            assert route.cost == least, k
            assert _cost_of(route, costs) == route.cost


def _number(cell: tuple[int, int], costs: Costs) -> int:
    return cell[0] * costs.shape[1] + cell[1]


@pytest.mark.parametrize("seed", range(10))
def test_a_route_goes_from_start_to_goal_by_legal_moves(seed: int) -> None:
    costs = _random_costs(seed)
    costs[0, 0] = costs[-1, -1] = OPEN
    route = search(costs, (0, 0), (costs.shape[0] - 1, costs.shape[1] - 1))
    if isinstance(route, Rejected):
        return
    assert route.cells[0].tolist() == [0, 0]
    assert route.cells[-1].tolist() == [costs.shape[0] - 1, costs.shape[1] - 1]
    assert (costs[tuple(route.cells.T)] > 0).all()
    assert (np.abs(np.diff(route.cells, axis=0)).max(1) == 1).all()
    for (r, c), (i, j) in zip(route.cells[:-1], route.cells[1:], strict=True):
        assert costs[r, j] > 0
        assert costs[i, c] > 0


def test_corners_are_not_cut() -> None:
    costs = np.full((3, 3), OPEN, np.int32)
    costs[1, 1] = SHUT
    assert _found(costs, (0, 1), (1, 2)).cells.tolist() == [[0, 1], [0, 2], [1, 2]]


def test_cells_that_meet_only_at_a_corner_are_not_joined() -> None:
    costs = np.array([[OPEN, SHUT], [SHUT, OPEN]], np.int32)
    assert isinstance(search(costs, (0, 0), (1, 1)), Rejected)


def test_a_dearer_cell_is_gone_round() -> None:
    costs = np.full((3, 5), OPEN, np.int32)
    costs[1, 2] = 4 * UNIT
    assert [1, 2] not in _found(costs, (1, 0), (1, 4)).cells.tolist()
    costs[1, 2] = OPEN
    assert [1, 2] in _found(costs, (1, 0), (1, 4)).cells.tolist()


def test_on_an_empty_grid_only_the_route_is_expanded() -> None:
    # F is the same for all cells of a diagonal, which is the only shortest route.
    route = _found(np.full((50, 50), OPEN, np.int32), (0, 0), (49, 49))
    assert route.expanded == 49
    assert route.cost == pytest.approx(49 * np.sqrt(2), rel=2e-4)


def test_a_route_to_where_one_is_costs_nothing() -> None:
    route = _found(np.full((2, 2), OPEN, np.int32), (1, 0), (1, 0))
    assert (route.cells.tolist(), route.cost, route.expanded) == ([[1, 0]], 0.0, 0)


def test_costs_that_differ_by_orders_of_magnitude_stay_exact() -> None:
    costs = np.full((3, 40), OPEN, np.int32)
    costs[:, 20] = 1000 * UNIT
    assert _found(costs, (1, 0), (1, 39)).cost == 38.5 + 1000 - 0.5


@pytest.mark.parametrize("ends", [((0, 0), (1, 1)), ((1, 1), (0, 0))])
def test_a_blocked_end_is_an_error(ends: tuple[tuple[int, int], tuple[int, int]]) -> None:
    costs = np.array([[SHUT, OPEN], [OPEN, OPEN]], np.int32)
    with pytest.raises(ValueError, match="blocked"):
        search(costs, *ends)
