import dataclasses
import re

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from vnav.config import PlanConfig
from vnav.core import se3
from vnav.core.frame import Rejected
from vnav.core.grid import FREE, OCCUPIED, UNKNOWN, WALKED, Grid
from vnav.errors import ConfigError
from vnav.planning.costmap import costmap
from vnav.planning.planner import Plan, heading_rad, plan_path

CONFIG = PlanConfig()
UNCERTAINTY_M = 0.02
KEEP_OFF_M = CONFIG.robot_radius_m + UNCERTAINTY_M + 0.05 * np.sqrt(0.5)


def _rooms() -> Grid:
    """Two rooms of 4 m x 5 m joined by a door 0.9 m wide, a table, a screen, some unknown floor."""
    cells = np.full((100, 165), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    cells[:, 80:84] = OCCUPIED
    cells[40:58, 80:84] = FREE
    cells[20:40, 110:130] = OCCUPIED
    cells[60:63, 20:60] = OCCUPIED
    cells[63:80, 30:50] = UNKNOWN
    return Grid((-1.0, -2.0), 0.05, cells)


ROOMS = _rooms()


def _far_from_obstacles(margin_m: float) -> NDArray[np.float64]:
    """Centres (N, 2) of free cells with a margin to spare."""
    distance_m = ndimage.distance_transform_edt(ROOMS.cells != OCCUPIED) * 0.05
    free = (ROOMS.cells == FREE) & (distance_m >= KEEP_OFF_M + margin_m)
    return ROOMS.centres_of(np.argwhere(free))


def _pairs(count: int) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """Start and goal anywhere in cells where the robot fits."""
    rng = np.random.default_rng(0)
    centres = _far_from_obstacles(0.0)
    pairs = centres[rng.integers(0, len(centres), (count, 2))]
    pairs = pairs + rng.uniform(-0.024, 0.024, pairs.shape)
    return [(tuple(a.tolist()), tuple(b.tolist())) for a, b in pairs]


def _found(
    start: tuple[float, float], goal: tuple[float, float], grid: Grid = ROOMS, **changes: float
) -> Plan:
    config = dataclasses.replace(CONFIG, **changes)
    plan = plan_path(costmap(grid, UNCERTAINTY_M, config), start, goal)
    assert isinstance(plan, Plan)
    return plan


def test_a_path_that_is_not_smoothed_joins_the_centres_of_its_cells() -> None:
    """Between its ends, which stay where they are; a smoothed one is shorter."""
    start, goal = (0.02, -1.01), (5.51, 1.52)
    path = _found(start, goal, smooth=False)
    corners = path.poses[1:-1, :2]
    off = np.abs((corners - ROOMS.origin) / ROOMS.resolution_m % 1 - 0.5)
    is_centre = (off < 1e-6).all(1)
    steps = np.hypot(*np.diff(corners[is_centre], axis=0).T) / ROOMS.resolution_m
    assert set(np.round(steps, 6)) == {1.0, round(float(np.sqrt(2)), 6)}
    assert path.poses[0, :2].tolist() == list(start)
    assert path.poses[-1, :2].tolist() == list(goal)
    assert _found(start, goal).length_m < path.length_m


@pytest.mark.parametrize(("start", "goal"), _pairs(25))
def test_a_path_never_enters_an_inflated_or_unknown_cell(
    start: tuple[float, float], goal: tuple[float, float]
) -> None:
    plan = _found(start, goal)
    distance_m = ndimage.distance_transform_edt(ROOMS.cells != OCCUPIED) * 0.05
    xy = plan.poses[:, :2]
    parts = np.linspace(0, 1, 60)[:, None, None]
    cells = ROOMS.cells_at(xy[:-1] + parts * np.diff(xy, axis=0)).reshape(-1, 2).T
    assert (distance_m[tuple(cells)] >= KEEP_OFF_M).all()
    assert (ROOMS.cells[tuple(cells)] == FREE).all()
    least_m = distance_m[tuple(ROOMS.cells_at(xy).T)].min() - 0.05 * np.sqrt(0.5)
    assert plan.clearance_min_m <= least_m + 1e-9
    assert plan.clearance_min_m >= CONFIG.robot_radius_m + UNCERTAINTY_M


@pytest.mark.parametrize(("start", "goal"), _pairs(10))
def test_a_path_can_be_followed(start: tuple[float, float], goal: tuple[float, float]) -> None:
    plan = _found(start, goal)
    assert plan.poses[0, :2].tolist() == list(start)
    assert plan.poses[-1, :2].tolist() == list(goal)
    steps = np.diff(plan.poses[:, :2], axis=0)
    lengths = np.hypot(*steps.T)
    assert lengths.min() > 0
    assert lengths.max() <= CONFIG.spacing_m + 1e-9
    assert plan.length_m == pytest.approx(lengths.sum(), abs=1e-9)
    ahead = np.stack([np.cos(plan.poses[:-1, 2]), np.sin(plan.poses[:-1, 2])], 1)
    np.testing.assert_allclose(ahead * lengths[:, None], steps, atol=1e-9)


def test_more_weight_on_clearance_gives_more_clearance() -> None:
    ends = (0.0, 0.0), (6.5, 2.5)
    near = _found(*ends, clearance_weight=0.0)
    far = _found(*ends, clearance_weight=2.0)
    assert near.clearance_min_m < 0.25  # round the door's edge
    assert far.clearance_min_m > near.clearance_min_m + 0.1
    assert near.length_m < far.length_m < 1.1 * near.length_m


def test_the_last_yaw_is_the_goals_heading() -> None:
    plan = plan_path(costmap(ROOMS, 0.0, CONFIG), (0.0, 0.0), (1.0, 0.0), final_yaw_rad=-2.5)
    assert isinstance(plan, Plan)
    assert plan.poses[-1, 2] == -2.5
    assert plan.poses[0, 2] == pytest.approx(0.0)


def test_without_a_heading_the_last_direction_is_kept() -> None:
    assert _found((0.0, 0.0), (1.0, 0.0)).poses[-1, 2] == pytest.approx(0.0)


def test_a_path_to_where_one_is_is_one_pose() -> None:
    plan = plan_path(costmap(ROOMS, 0.0, CONFIG), (0.01, 0.01), (0.01, 0.01), final_yaw_rad=1.0)
    assert isinstance(plan, Plan)
    assert plan.poses.tolist() == [[0.01, 0.01, 1.0]]
    assert plan.length_m == 0


def test_a_path_within_one_cell_is_straight() -> None:
    plan = _found((0.01, 0.01), (0.04, 0.03))
    np.testing.assert_allclose(plan.poses[:, :2], [[0.01, 0.01], [0.04, 0.03]])


def test_a_goal_in_the_table_is_moved_beside_it() -> None:
    goal = (5.0, -0.2)  # 0.2 m inside the table, which ends at y = 0
    plan = _found((0.0, 0.0), goal)
    assert plan.goal.asked == goal
    assert 0.2 + CONFIG.robot_radius_m < plan.goal.moved_m <= CONFIG.tolerance_m
    assert plan.poses[-1, :2].tolist() == list(plan.goal.snapped)


def test_a_goal_too_far_inside_the_table_names_the_tolerance_that_it_takes() -> None:
    ends = (0.0, 0.0), (5.0, -0.5)  # 0.5 m inside the table
    refused = plan_path(costmap(ROOMS, UNCERTAINTY_M, CONFIG), *ends)
    assert isinstance(refused, Rejected)
    assert "lies in an obstacle" in refused.reason
    assert "radius" not in refused.reason
    named = re.search(r"\(--tolerance ([0-9.]+)\)", refused.reason)
    assert named
    plan = _found(*ends, tolerance_m=float(named[1]))
    assert 0 < float(named[1]) - plan.goal.moved_m <= 0.01


def test_unknown_space_is_crossed_only_if_allowed() -> None:
    ends = (1.0, 1.9), (1.0, 3.0 - 0.75)
    round_it = _found((0.2, 1.7), (1.9, 1.7))
    across = _found((0.2, 1.7), (1.9, 1.7), allow_unknown=True, unknown_cost=1.0)
    assert across.length_m < 1.02 * np.hypot(1.7, 0)
    assert round_it.length_m > 1.1 * across.length_m
    refused = plan_path(costmap(ROOMS, 0.0, dataclasses.replace(CONFIG, tolerance_m=0.1)), *ends)
    assert isinstance(refused, Rejected)
    assert "unknown space" in refused.reason
    assert "(--allow-unknown)" in refused.reason


def _with_a_corridor() -> Grid:
    """The rooms, and a corridor of 0.4 m through the unknown floor, 1 m long, to a wall."""
    cells = ROOMS.cells.copy()
    cells[67:75, 30:50] = WALKED
    return Grid(ROOMS.origin, ROOMS.resolution_m, cells)


def test_walked_floor_is_crossed_where_that_costs_less_and_the_path_says_how_far() -> None:
    ends, corridor = ((0.2, 1.55), (1.9, 1.55)), _with_a_corridor()
    cheap = _found(*ends, corridor, clearance_weight=0.0, walked_cost=1.0)
    assert cheap.walked_m == pytest.approx(1.0, abs=0.05)  # a cell
    assert cheap.length_m == pytest.approx(1.7)
    dear = _found(*ends, corridor, clearance_weight=0.0, walked_cost=100.0)
    assert dear.walked_m == 0
    assert dear.length_m > 1.05 * cheap.length_m
    refused = _found(*ends, corridor, allow_walked=False, walked_cost=1.0)
    assert refused.poses.tobytes() == _found(*ends).poses.tobytes()


def test_a_place_on_walked_floor_is_not_moved_and_one_beside_it_is_moved_there() -> None:
    corridor = _with_a_corridor()
    plan = _found((1.0, 1.55), (4.0, 2.0), corridor)
    assert (plan.start.moved_m, plan.walked_m > 0.3) == (0, True)
    beside = _found((1.0, 1.80), (4.0, 2.0), corridor)
    assert beside.start.snapped == pytest.approx((1.0, 1.725), abs=0.03)
    off = dataclasses.replace(CONFIG, allow_walked=False, tolerance_m=0.3)
    refused, bare = (
        plan_path(costmap(grid, UNCERTAINTY_M, off), (1.0, 1.55), (4.0, 2.0))
        for grid in (corridor, ROOMS)
    )
    assert refused == bare
    assert isinstance(refused, Rejected)
    assert "lies in unknown space; the nearest cell the robot can be in is" in refused.reason


@pytest.mark.parametrize("seed", range(6))
def test_a_path_over_walked_floor_keeps_clear_of_what_stands_beside_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cells = np.full((60, 60), UNKNOWN, np.uint8)
    cells[:12] = cells[-12:] = FREE
    cells[12:-12, 15:45] = WALKED
    cells[rng.integers(12, 48, 12), rng.integers(10, 50, 12)] = OCCUPIED
    grid = Grid((0.0, 0.0), 0.05, cells)
    plan = plan_path(costmap(grid, UNCERTAINTY_M, CONFIG), (1.5, 0.3), (1.5, 2.7))
    if isinstance(plan, Rejected):
        assert "separate regions" in plan.reason
        return
    away_m = ndimage.distance_transform_edt(cells != OCCUPIED) * 0.05
    row, column = grid.cells_at(plan.poses[:, :2]).T
    assert away_m[row, column].min() >= KEEP_OFF_M
    assert (cells[row, column] != UNKNOWN).all()
    assert 1.8 <= plan.walked_m <= plan.length_m


def test_a_robot_too_wide_for_the_door_gets_the_reason() -> None:
    config = dataclasses.replace(CONFIG, robot_radius_m=0.45)
    refused = plan_path(costmap(ROOMS, 0.0, config), (0.0, 0.0), (6.0, 1.5))
    assert isinstance(refused, Rejected)
    assert "separate regions" in refused.reason
    assert "less radius than 0.45 m" in refused.reason


@pytest.mark.parametrize(
    "change",
    [
        {"spacing_m": 0.0},
        {"clearance_range_m": 0.0},
        {"clearance_weight": -1.0},
        {"unknown_cost": 0},
    ],
)
def test_a_setting_that_makes_no_sense_is_an_error(change: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match=rf"plan\.{next(iter(change))} to be a number .* found"):
        dataclasses.replace(CONFIG, **change)


def test_the_same_question_has_the_same_answer_to_the_last_bit() -> None:
    first, second = (_found((0.0, 0.0), (6.5, 2.5)) for _ in range(2))
    assert first.poses.tobytes() == second.poses.tobytes()


@pytest.mark.parametrize("pitch_deg", [-60, 0, 40])
def test_a_heading_is_where_the_camera_looks_on_the_floor(pitch_deg: float) -> None:
    # Camera axes x right, y down, z forward; level and looking along the world's x axis:
    level = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], float)
    turn = se3.exp_so3([0, 0, np.deg2rad(120)])
    R = turn @ level @ se3.exp_so3([np.deg2rad(pitch_deg), 0, 0])
    assert heading_rad(se3.make(R, np.zeros(3))) == pytest.approx(np.deg2rad(120), abs=1e-12)


@pytest.mark.parametrize("pitch_deg", [-89, 89])
def test_a_camera_that_looks_straight_down_or_up_keeps_its_heading(pitch_deg: float) -> None:
    level = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], float)
    R = level @ se3.exp_so3([np.deg2rad(pitch_deg), 0, 0])
    assert heading_rad(se3.make(R, np.zeros(3))) == pytest.approx(0.0, abs=1e-12)
