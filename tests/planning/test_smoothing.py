import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from vnav.planning.astar import UNIT, Route, search
from vnav.planning.lanes import Lanes
from vnav.planning.smoothing import segment_cost, smooth

Costs = NDArray[np.int32]
Array = NDArray[np.float64]


def _open(rows: int = 12, columns: int = 12) -> Costs:
    return np.full((rows, columns), UNIT, np.int32)


def _no_lanes(costs: Costs) -> Lanes:
    return Lanes(np.zeros(costs.shape, np.int32), np.zeros((1, 1, 2)))


def _smoothed(points: Array, costs: Costs) -> Array:
    return smooth(points, costs, _no_lanes(costs))


def _straight(costs: Costs, a: Array, b: Array) -> float:
    return segment_cost(costs, _no_lanes(costs), a, b)


def _random_case(seed: int) -> tuple[Costs, Array]:
    """Blocks on a grid, costs that fall away from them, and a cheapest route across."""
    rng = np.random.default_rng(seed)
    costs = _open(60, 60)
    for row, column in rng.integers(0, 55, (25, 2)):
        costs[row : row + 5, column : column + 5] = 2 * UNIT
    for row, column in rng.integers(0, 57, (40, 2)):
        costs[row : row + 3, column : column + 3] = 0
    costs[:3, :3] = costs[-3:, -3:] = UNIT
    route = search(costs, (0, 0), (59, 59))
    points = route.cells[:, ::-1] + 0.5 if isinstance(route, Route) else np.zeros((0, 2))
    return costs, points


CASES = [(costs, points) for costs, points in map(_random_case, range(40)) if len(points)]


def _length(path: Array) -> float:
    return float(np.hypot(*np.diff(path, axis=0).T).sum())


def _cost(path: Array, costs: Costs) -> float:
    return sum(_straight(costs, a, b) for a, b in zip(path[:-1], path[1:], strict=True))


def test_there_are_routes_to_smooth() -> None:
    assert len(CASES) > 20


@pytest.mark.parametrize(("costs", "points"), CASES)
def test_smoothing_enters_no_blocked_cell_lengthens_nothing_and_costs_no_more(
    costs: Costs, points: Array
) -> None:
    path = _smoothed(points, costs)
    np.testing.assert_array_equal(path[[0, -1]], points[[0, -1]])
    assert _length(path) <= _length(points) + 1e-9
    assert _cost(path, costs) <= _cost(points, costs) + 1e-6
    parts = np.linspace(0, 1, 2000)[:, None]
    for a, b in zip(path[:-1], path[1:], strict=True):
        columns, rows = np.floor(a + parts * (b - a)).astype(int).T
        assert (costs[rows, columns] > 0).all()


def test_smoothing_shortens_most_routes() -> None:
    ratios = [_length(_smoothed(points, costs)) / _length(points) for costs, points in CASES]
    assert np.median(ratios) < 0.97  # 8-connected routes are up to 8 % longer than straight ones


def test_on_an_empty_grid_the_path_is_straight() -> None:
    route = search(_open(), (0, 0), (3, 11))
    assert isinstance(route, Route)
    path = _smoothed(route.cells[:, ::-1] + 0.5, _open())
    assert path.tolist() == [[0.5, 0.5], [11.5, 3.5]]


def test_a_path_keeps_off_what_is_dear() -> None:
    costs = _open(12, 30)
    costs[:8, 10:20] = 5 * UNIT  # 10 cells wide: across it costs 50, round it far less
    route = search(costs, (0, 0), (0, 29))
    assert isinstance(route, Route)
    path = _smoothed(route.cells[:, ::-1] + 0.5, costs)
    middle = path[(path[:, 0] > 11) & (path[:, 0] < 19)]
    assert (middle[:, 1] >= 8).all()


def test_where_there_is_room_corners_are_rounded() -> None:
    shut = np.zeros((40, 40), bool)
    shut[10:, :25] = True
    near = np.clip(1 - ndimage.distance_transform_edt(~shut) / 10, 0, 1)
    costs = np.where(shut, 0, UNIT * (1 + near)).astype(np.int32)
    route = search(costs, (5, 0), (39, 33))
    assert isinstance(route, Route)
    towards = np.diff(_smoothed(route.cells[:, ::-1] + 0.5, costs), axis=0)
    turns = np.abs(np.diff(np.arctan2(towards[:, 1], towards[:, 0])))
    assert turns.sum() > np.deg2rad(45)
    assert turns.max() < np.deg2rad(25)  # the route itself turns by 45 degrees at a time


@pytest.mark.parametrize(
    ("a", "b", "cost"),
    [
        ((0.5, 0.5), (4.5, 0.5), 4.0),  # a straight move costs the mean of its two cells
        ((0.5, 0.5), (3.5, 3.5), 3 * np.sqrt(2)),  # through corners
        ((0.2, 0.3), (0.2, 0.3), 0.0),
        ((4.5, 4.5), (0.5, 1.5), 5.0),  # backwards
        ((0.5, 2.0), (4.5, 2.0), 4.0),  # along a border
    ],
)
def test_what_a_segment_costs_among_cells_of_cost_one(
    a: tuple[float, float], b: tuple[float, float], cost: float
) -> None:
    assert _straight(_open(), np.array(a), np.array(b)) == pytest.approx(cost, abs=1e-12)


def test_a_segment_costs_the_integral_of_its_cells() -> None:
    rng = np.random.default_rng(3)
    costs = rng.integers(UNIT, 4 * UNIT, (12, 12)).astype(np.int32)
    for a, b in rng.uniform(0, 12, (50, 2, 2)):
        parts = (np.arange(100_000) + 0.5) / 100_000
        columns, rows = np.floor(a + parts[:, None] * (b - a)).astype(int).T
        expected = costs[rows, columns].mean() / UNIT * np.hypot(*(b - a))
        # each of the 100,000 samples may lie in the wrong cell at up to 24 borders
        assert _straight(costs, a, b) == pytest.approx(expected, abs=24e-5 * 4 * 17)


def test_a_segment_does_not_slip_between_cells_that_meet_at_a_corner() -> None:
    costs = _open(2, 2)
    costs[0, 1] = 0
    assert _straight(costs, np.array([0.5, 0.5]), np.array([1.5, 1.5])) == np.inf
    assert _straight(costs, np.array([1.9, 1.5]), np.array([0.5, 0.1])) == np.inf


def test_a_segment_through_a_blocked_cell_costs_more_than_anything() -> None:
    costs = _open(5, 5)
    costs[2, 2] = 0
    assert _straight(costs, np.array([0.5, 2.5]), np.array([4.5, 2.5])) == np.inf
    assert _straight(costs, np.array([0.5, 2.5]), np.array([4.5, 4.5])) < np.inf
