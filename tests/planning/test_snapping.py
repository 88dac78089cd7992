import dataclasses

import numpy as np
import pytest

from vnav.config import PlanConfig
from vnav.core.frame import Rejected
from vnav.core.grid import FREE, OCCUPIED, UNKNOWN, WALKED, Grid
from vnav.planning.costmap import Costmap, costmap
from vnav.planning.snapping import SnappedPoint, snap_start_and_goal

# A point robot on cells of 10 cm: only occupied cells and their neighbours' corners matter.
CONFIG = PlanConfig(robot_radius_m=0.0)
LETTERS = {".": FREE, "#": OCCUPIED, "?": UNKNOWN, "w": WALKED}


def _map(*rows: str, robot_radius_m: float = 0.0) -> Costmap:
    """A costmap from a drawing whose last line is the first row; cells of 10 cm."""
    cells = np.array([[LETTERS[letter] for letter in row] for row in rows[::-1]], np.uint8)
    config = dataclasses.replace(CONFIG, robot_radius_m=robot_radius_m)
    return costmap(Grid((0, 0), 0.1, cells), 0.0, config)


def _snapped(
    where: Costmap, start: tuple[float, float], goal: tuple[float, float], tolerance_m: float = 0.5
) -> tuple[SnappedPoint, SnappedPoint]:
    snapped = snap_start_and_goal(where, start, goal, tolerance_m)
    assert not isinstance(snapped, Rejected)
    return snapped


def _reason(
    where: Costmap, start: tuple[float, float], goal: tuple[float, float], tolerance_m: float = 0.5
) -> str:
    snapped = snap_start_and_goal(where, start, goal, tolerance_m)
    assert isinstance(snapped, Rejected)
    return snapped.reason


def test_places_where_the_robot_can_be_are_not_moved() -> None:
    start, goal = _snapped(_map(".........", "........."), (0.03, 0.07), (0.81, 0.19))
    assert (start.asked, start.snapped, start.moved_m) == ((0.03, 0.07), (0.03, 0.07), 0)
    assert (start.cell, goal.cell) == ((0, 0), (1, 8))


def test_a_goal_in_an_obstacle_is_moved_to_the_nearest_cell_and_the_distance_is_told() -> None:
    _, goal = _snapped(_map("....##.."), (0.05, 0.05), (0.45, 0.05))
    assert goal.snapped == pytest.approx((0.35, 0.05))
    assert goal.moved_m == pytest.approx(0.1)
    assert goal.asked == (0.45, 0.05)


def test_a_goal_too_near_an_obstacle_is_moved_to_where_the_robot_fits() -> None:
    where = _map(".......", ".......", "#######", robot_radius_m=0.12)
    _, goal = _snapped(where, (0.05, 0.25), (0.35, 0.15))
    # 0.1 m from the wall's centre is too near, 0.2 m is not: 0.12 m and half a diagonal of 0.07 m
    assert goal.snapped == pytest.approx((0.35, 0.25))


def test_a_start_outside_the_grid_may_be_near_enough_to_be_moved_into_it() -> None:
    start, _ = _snapped(_map("......"), (-0.15, 0.05), (0.45, 0.05))
    assert start.snapped == pytest.approx((0.05, 0.05))
    assert start.moved_m == pytest.approx(0.2)


def test_no_place_is_moved_farther_than_the_tolerance() -> None:
    reason = _reason(_map("..####"), (0.05, 0.05), (0.55, 0.05), tolerance_m=0.35)
    assert "goal (0.55, 0.05) lies in an obstacle" in reason
    assert "0.40 m away, the tolerance is 0.35 m" in reason
    assert _snapped(_map("..####"), (0.05, 0.05), (0.55, 0.05), 0.45)[1].cell == (0, 1)


@pytest.mark.parametrize(
    ("start", "state"),
    [((-2.0, 0.05), "outside the grid"), ((0.95, 0.05), "unknown"), ((0.55, 0.05), "obstacle")],
)
def test_what_is_wrong_with_a_place_is_said(start: tuple[float, float], state: str) -> None:
    assert state in _reason(_map("..####????"), start, (0.05, 0.05), tolerance_m=0.2)


def test_a_place_is_not_moved_through_a_wall() -> None:
    where = _map("....?#....", "....?#....", "....?#....")
    # The nearest cell of all to the goal lies beyond the wall, 0.25 m away.
    goal = _snapped(where, (0.05, 0.15), (0.42, 0.15))[1]
    assert goal.cell == (1, 3)
    left = _reason(where, (0.05, 0.15), (0.68, 0.15))
    assert "separate regions" in left


def test_a_place_walled_in_is_told_from_one_too_far_away() -> None:
    where = _map("......#...#....", robot_radius_m=0.15)
    reason = _reason(where, (0.05, 0.05), (0.85, 0.05), tolerance_m=0.6)
    assert "goal (0.85, 0.05) is 0.13 m from an obstacle" in reason
    assert "and beyond an obstacle" in reason


def test_many_places_are_looked_at_in_parts() -> None:
    where = _map(*["." * 80] * 80, "#" * 80)
    start, goal = _snapped(where, (0.05, -0.05), (4.05, 0.05), tolerance_m=9.0)
    assert start.cell == (1, 0)
    assert goal.cell == (1, 40)


def test_a_place_in_unknown_space_within_an_obstacle_may_leave_it() -> None:
    # As above a table whose top was seen only at its edge.
    where = _map(".......", ".#####.", ".#???#.", ".#####.", ".......")
    goal = _snapped(where, (0.05, 0.05), (0.35, 0.25))[1]
    assert goal.moved_m == pytest.approx(0.2)


def test_a_place_on_walked_floor_is_no_inside_of_an_obstacle_and_does_not_pass_a_wall() -> None:
    inside = _map("?#....")
    assert _snapped(inside, (0.05, 0.05), (0.55, 0.05))[0].cell == (0, 2)
    assert "separate regions" in _reason(_map("w##..."), (0.05, 0.05), (0.55, 0.05))


def test_a_place_in_a_pocket_of_seen_floor_is_moved_across_the_unknown_to_what_is_joined() -> None:
    _, goal = _snapped(_map("....??.??"), (0.05, 0.05), (0.65, 0.05))
    assert goal.snapped == pytest.approx((0.35, 0.05))
    assert goal.moved_m == pytest.approx(0.3)


def test_a_place_is_not_moved_through_a_gap_too_narrow_for_the_robot() -> None:
    rows = [".....#.....", ".....#.....", "...........", ".....#.....", ".....#....."]
    where = _map(*rows, robot_radius_m=0.05)
    assert where.regions[2, 3] != where.regions[2, 7] != 0
    reason = _reason(where, (0.05, 0.25), (0.75, 0.25))
    assert "separate regions" in reason


def test_of_two_regions_the_one_that_moves_both_ends_least_is_taken() -> None:
    start, goal = _snapped(_map("..?...?....."), (0.25, 0.05), (0.65, 0.05))
    assert (start.cell, goal.cell) == ((0, 3), (0, 5))


def test_on_a_grid_without_room_the_reason_says_so() -> None:
    assert (
        _reason(_map("####"), (0.05, 0.05), (0.15, 0.05)) == "the robot fits nowhere on this grid"
    )
