"""Paths of a robot that is no disc, held against polygons laid over the grid."""

import dataclasses

import numpy as np
import pytest
from matplotlib.path import Path as Outline
from numpy.typing import NDArray

from vnav.config import PlanConfig
from vnav.config.outline import corners_of
from vnav.core.frame import Rejected
from vnav.core.grid import FREE, OCCUPIED, Grid
from vnav.planning.costmap import costmap, radii_m
from vnav.planning.narrowest import NoPath
from vnav.planning.planner import Plan, plan_path

Array = NDArray[np.float64]
LONG = "0.4,0.15 -0.4,0.15 -0.4,-0.15 0.4,-0.15"  # 0.8 m x 0.3 m
L_SHAPE = "0.3,0.1 0.0,0.1 0.0,0.3 -0.2,0.3 -0.2,-0.1 0.3,-0.1"
CELL_M = 0.05
CONFIG = PlanConfig(footprint=LONG, clearance_weight=0.5)
PASSABLE = {
    LONG: {1, 2, 4, 5, 7},
    L_SHAPE: {0, 1, 2, 3, 4, 6, 7},
}  # seeds whose clutter leaves a way


def _walled(rows: int, columns: int) -> NDArray[np.uint8]:
    cells = np.full((rows, columns), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    return cells


def _gap(width: int) -> Grid:
    """Two rooms of 2 m x 3 m, and a gap of so many cells through the wall of 0.5 m between them."""
    cells = _walled(60, 92)
    cells[:, 41:51] = OCCUPIED
    cells[20 : 20 + width, 41:51] = FREE
    return Grid((0.0, 0.0), CELL_M, cells)


def _plan(grid: Grid, start: tuple[float, float], goal: tuple[float, float], **more: float) -> Plan:
    yaw_rad = more.pop("yaw_rad", None)
    config = dataclasses.replace(CONFIG, **more)
    found = plan_path(costmap(grid, 0.0, config), start, goal, final_yaw_rad=yaw_rad)
    assert isinstance(found, Plan)
    return found


def _hit(grid: Grid, poses: Array, footprint: str = LONG) -> bool:
    """Whether a corner, a middle of a side or the centre of an occupied cell is ever inside.

    Poses between those of the path are looked at too: every 5 mm, and every degree of each turn.
    """
    corners = np.array(corners_of(footprint))
    offsets = np.stack(np.meshgrid([0.02, 0.5, 0.98], [0.02, 0.5, 0.98]), -1).reshape(-1, 2)
    cells = np.argwhere(grid.cells == OCCUPIED)[:, ::-1]
    points = ((cells[:, None] + offsets) * CELL_M + grid.origin).reshape(-1, 2)
    reach_m = np.hypot(*corners.T).max()
    for x, y, yaw in _between(poses):
        near = points[np.hypot(*(points - (x, y)).T) < reach_m]
        R = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        if Outline(corners).contains_points((near - (x, y)) @ R).any():
            return True
    return False


def _between(poses: Array) -> Array:
    """A robot's poses as it follows a path: on along each yaw, then round to the next one."""
    parts = []
    for (x, y, yaw), (i, j, other) in zip(poses[:-1], poses[1:], strict=True):
        ahead = np.linspace(0, 1, 11)[:, None] * (i - x, j - y) + (x, y)
        parts.append(np.column_stack([ahead, np.full(11, yaw)]))
        turn = (other - yaw + np.pi) % (2 * np.pi) - np.pi
        count = 2 + int(np.rad2deg(abs(turn)))
        yaws = yaw + np.linspace(0, turn, count)
        parts.append(np.column_stack([np.full((count, 2), (i, j)), yaws]))
    return np.concatenate([*parts, poses[-1:]])


def test_the_radii_of_a_footprint_are_those_of_its_inner_and_outer_disc() -> None:
    assert radii_m(CONFIG) == pytest.approx((0.15, np.hypot(0.4, 0.15)))
    assert radii_m(dataclasses.replace(CONFIG, footprint=L_SHAPE)) == pytest.approx(
        (0.1, np.hypot(0.2, 0.3))
    )


def test_a_long_robot_goes_lengthwise_through_a_gap_that_is_narrower_than_it_is_long() -> None:
    # 0.3 m, and on both sides a cell's half diagonal less its half edge: 9 cells leave 15 cm
    found = _plan(_gap(9), (1.0, 2.5), (3.5, 2.5))
    inside = (found.poses[:, 0] > 2.05) & (found.poses[:, 0] < 2.55)
    assert inside.any()
    assert np.abs(np.sin(found.poses[inside, 2])).max() < 0.2
    assert not _hit(_gap(9), found.poses)
    disc = dataclasses.replace(CONFIG, footprint="", robot_radius_m=radii_m(CONFIG)[1])
    assert isinstance(plan_path(costmap(_gap(9), 0.0, disc), (1.0, 2.5), (3.5, 2.5)), Rejected)


def test_a_robot_as_wide_as_it_is_long_does_not_fit_through_that_gap() -> None:
    square = dataclasses.replace(CONFIG, footprint="0.4,0.4 -0.4,0.4 -0.4,-0.4 0.4,-0.4")
    refused = plan_path(costmap(_gap(9), 0.0, square), (1.0, 1.25), (3.5, 1.25))
    assert isinstance(refused, Rejected)


def _bend(width: int) -> Grid:
    """A corridor of so many cells that turns once at a right angle, each arm 2.5 m long."""
    cells = np.full((60, 60), OCCUPIED, np.uint8)
    cells[5 : 5 + width, 5:55] = FREE
    cells[5:55, 55 - width : 55] = FREE
    return Grid((0.0, 0.0), CELL_M, cells)


def test_a_long_robot_turns_only_where_a_bend_is_wide_enough() -> None:
    # On the spot it needs 0.85 m and a cell's diagonal: 0.92 m; 0.5 m of width is too little even
    # if it cuts the corner, for a robot of 0.8 m that turns on the spot only.
    ends = (0.9, 0.5), (2.5, 2.2)
    refused = plan_path(costmap(_bend(10), 0.0, CONFIG), *ends)
    assert isinstance(refused, NoPath)
    assert "; it has room to pass straight, but not to turn: the narrowest place" in refused.reason
    assert refused.reason.endswith("the robot needs 0.38 m to pass straight and 0.93 m to turn")
    wide = _plan(_bend(20), *ends)
    assert not _hit(_bend(20), wide.poses)


def test_a_goal_s_heading_is_turned_to_where_there_is_room() -> None:
    cells = _walled(60, 60)
    cells[20:, :20] = cells[20:, 30:] = OCCUPIED  # a dead end of 10 cells, 2 m long
    grid = Grid((0.0, 0.0), CELL_M, cells)
    along = _plan(grid, (0.7, 0.5), (1.25, 2.2), yaw_rad=np.pi / 2)
    assert along.poses[-1, 2] == np.pi / 2
    assert not _hit(grid, along.poses)
    across = plan_path(costmap(grid, 0.0, CONFIG), (0.7, 0.5), (1.25, 2.2), final_yaw_rad=0.0)
    assert isinstance(across, Rejected)


def test_a_turn_that_is_free_only_the_longer_way_round_is_not_made() -> None:
    """A post stands 60 degrees to the left of where a robot with a long nose comes to a stop."""
    nose, at = "0.5,0.1 -0.1,0.1 -0.1,-0.1 0.5,-0.1", (1.525, 1.525)
    cells = _walled(60, 60)
    cells[36:38, 32:34] = OCCUPIED
    grid = Grid((0.0, 0.0), CELL_M, cells)
    costs = costmap(grid, 0.0, dataclasses.replace(CONFIG, footprint=nose))
    came, yaw_rad = (0.725, 1.525), np.deg2rad(115)
    found = plan_path(costs, came, at, via=[at], final_yaw_rad=yaw_rad)
    assert isinstance(found, Plan)
    assert found.poses[-1] == pytest.approx([*at, yaw_rad])
    assert found.length_m > 1.0  # it goes away from there, and comes back with another yaw
    assert not _hit(grid, found.poses, nose)


def test_a_place_on_the_way_is_moved_to_where_a_footprint_can_turn() -> None:
    """0.275 m from a wall it can stand along that, but not turn away from it."""
    grid = Grid((0.0, 0.0), CELL_M, _walled(60, 60))
    by_wall, goal = (1.525, 0.325), (1.525, 2.525)
    found = plan_path(costmap(grid, 0.0, CONFIG), (0.6, 1.5), goal, via=[by_wall])
    assert isinstance(found, Plan)
    # its corners are 0.427 m off, the wall ends at 0.05 m, and cells are told to half a diagonal
    assert found.via[0].snapped[1] - 0.05 > np.hypot(0.4, 0.15)
    assert found.via[0].moved_m < 0.25
    assert not _hit(grid, found.poses)
    last = plan_path(costmap(grid, 0.0, CONFIG), (0.6, 1.5), by_wall)
    assert isinstance(last, Plan)
    assert last.goal.snapped[1] < found.via[0].snapped[1]


def _cluttered(seed: int) -> Grid:
    rng = np.random.default_rng(seed)
    cells = _walled(70, 70)
    for row, column in rng.integers(3, 62, (9, 2)):
        height, width = rng.integers(1, 8, 2)
        cells[row : row + height, column : column + width] = OCCUPIED
    return Grid((-1.0, 0.5), CELL_M, cells)


@pytest.mark.parametrize("footprint", [LONG, L_SHAPE])
@pytest.mark.parametrize("seed", range(8))
def test_a_footprint_never_touches_an_obstacle(seed: int, footprint: str) -> None:
    grid, rng = _cluttered(seed), np.random.default_rng(seed)
    costs = costmap(grid, 0.0, dataclasses.replace(CONFIG, footprint=footprint))
    cells = np.argwhere(costs.costs > 0)
    start, over, goal = (
        tuple(p) for p in (grid.centres_of(cells[rng.integers(len(cells), size=3)]) + 0.01).tolist()
    )
    found = plan_path(costs, start, goal, via=[over], final_yaw_rad=float(rng.uniform(-3, 3)))
    assert isinstance(found, NoPath) or not _hit(grid, found.poses, footprint)
    assert isinstance(found, Plan) or seed not in PASSABLE[footprint]
