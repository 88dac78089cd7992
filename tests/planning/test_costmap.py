import dataclasses

import numpy as np
import pytest
from scipy import ndimage

from vnav.config import PlanConfig
from vnav.core.grid import FREE, OCCUPIED, UNKNOWN, WALKED, Grid
from vnav.planning.astar import UNIT
from vnav.planning.costmap import costmap

CONFIG = PlanConfig(
    robot_radius_m=0.20, clearance_weight=1.0, clearance_range_m=0.30, unknown_cost=3.0
)
HALF_DIAGONAL_M = 0.05 * np.sqrt(0.5)


def _grid(occupied: list[tuple[int, int]], shape: tuple[int, int] = (21, 41)) -> Grid:
    cells = np.full(shape, FREE, np.uint8)
    for cell in occupied:
        cells[cell] = OCCUPIED
    return Grid((0, 0), 0.05, cells)


@pytest.mark.parametrize("share", [0.001, 0.02, 0.3, 0.9])
def test_clearance_is_the_distance_to_the_nearest_obstacle_less_half_a_diagonal(
    share: float,
) -> None:
    rng = np.random.default_rng(1)
    occupied = rng.random((57, 83)) < share
    occupied[3, 4] = True
    grid = Grid((0, 0), 0.05, np.where(occupied, OCCUPIED, FREE).astype(np.uint8))
    expected = ndimage.distance_transform_edt(~occupied) * 0.05 - HALF_DIAGONAL_M
    np.testing.assert_allclose(costmap(grid, 0.0, CONFIG).clearance_m, expected, atol=1e-12)


def test_without_obstacles_clearance_is_infinite_and_costs_are_least() -> None:
    result = costmap(_grid([]), 0.0, CONFIG)
    assert np.isinf(result.clearance_m).all()
    assert (result.costs == UNIT).all()


def test_obstacles_are_inflated_by_radius_half_a_diagonal_and_uncertainty() -> None:
    reach_m = 0.20 + HALF_DIAGONAL_M + 0.03  # 0.265 m: five cells of 5 cm, not six
    blocked = costmap(_grid([(10, 10)]), 0.03, CONFIG).costs[10, 10:] == 0
    assert np.flatnonzero(~blocked)[0] * 0.05 > reach_m > np.flatnonzero(blocked)[-1] * 0.05
    assert np.flatnonzero(blocked)[-1] == 5


def test_a_metre_costs_more_near_obstacles_as_declared() -> None:
    result = costmap(_grid([(10, 10)]), 0.0, CONFIG)
    spare_m = result.clearance_m[10, 15:] - 0.20
    expected = 1 + np.clip(1 - spare_m / 0.30, 0, 1)
    np.testing.assert_allclose(result.costs[10, 15:] / UNIT, expected, atol=0.5 / UNIT)
    assert result.costs[10, -1] == UNIT


def test_unknown_cells_are_blocked_unless_allowed_and_then_dear() -> None:
    cells = np.full((5, 5), FREE, np.uint8)
    cells[2, 2] = UNKNOWN
    grid = Grid((0, 0), 0.05, cells)
    assert costmap(grid, 0.0, CONFIG).costs[2, 2] == 0
    allowed = costmap(grid, 0.0, dataclasses.replace(CONFIG, allow_unknown=True))
    assert allowed.costs[2, 2] == 3 * UNIT


def test_walked_cells_cost_what_is_declared_and_are_unknown_where_not_allowed() -> None:
    cells = np.full((5, 5), FREE, np.uint8)
    cells[2, 2] = WALKED
    grid = Grid((0, 0), 0.05, cells)
    dear = dataclasses.replace(CONFIG, walked_cost=1.5)
    assert costmap(grid, 0.0, dear).costs[2, 2] == 1.5 * UNIT
    refused = costmap(grid, 0.0, dataclasses.replace(dear, allow_walked=False))
    assert (refused.costs[2, 2], refused.grid.cells[2, 2]) == (0, UNKNOWN)
    unknown = dataclasses.replace(dear, allow_walked=False, allow_unknown=True)
    assert costmap(grid, 0.0, unknown).costs[2, 2] == 3 * UNIT


def test_inflation_reaches_into_unknown_space() -> None:
    cells = np.full((5, 9), UNKNOWN, np.uint8)
    cells[2, 0] = OCCUPIED
    grid = Grid((0, 0), 0.05, cells)
    allowed = costmap(grid, 0.0, dataclasses.replace(CONFIG, allow_unknown=True))
    assert allowed.costs[2, 3] == 0
    assert allowed.costs[2, 8] > 0


def test_regions_are_cells_joined_by_their_sides() -> None:
    rng = np.random.default_rng(2)
    cells = np.where(rng.random((40, 60)) < 0.4, UNKNOWN, FREE).astype(np.uint8)
    regions = costmap(Grid((0, 0), 0.05, cells), 0.0, CONFIG).regions
    expected, count = ndimage.label(cells == FREE)
    assert regions.max() == count
    pairs = np.unique(np.stack([regions.ravel(), expected.ravel()]), axis=1)
    assert pairs.shape[1] == count + 1  # one to one, the blocked cells being 0 in both
    assert (regions == 0).tolist() == (expected == 0).tolist()
