"""What is said where there is no path, on grids whose gaps are known exactly."""

import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import ndimage

from vnav.config import PlanConfig
from vnav.core.grid import FREE, OCCUPIED, UNKNOWN, Grid
from vnav.core.places import OneWay, Zones
from vnav.planning.costmap import costmap
from vnav.planning.narrowest import NarrowPlace, NoPath, narrowest_place
from vnav.planning.planner import Plan, plan_path

CONFIG = PlanConfig(robot_radius_m=0.30)
ENDS = (1.0, 1.5), (3.4, 1.5)
SPARE_M = 0.05 * np.sqrt(2)  # a cell's half diagonal on each side


def _rooms(*gaps: tuple[int, int], wall: int = OCCUPIED) -> NDArray[np.uint8]:
    """Two rooms of 2 m x 3 m, and gaps through the wall between them: first row, how many."""
    cells = np.full((60, 88), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    cells[:, 42:46] = wall
    for row, width in gaps:
        cells[row : row + width, 42:46] = FREE
    return cells


def _refused(cells: NDArray[np.uint8], zones: Zones | None = None, **config: float) -> NoPath:
    grid = Grid((0.0, 0.0), 0.05, cells)
    costs = costmap(grid, 0.0, dataclasses.replace(CONFIG, **config), zones or Zones())
    found = plan_path(costs, *ENDS)
    assert isinstance(found, NoPath)
    return found


def _narrowest(cells: NDArray[np.uint8], **config: float) -> NarrowPlace:
    found = _refused(cells, **config).narrowest
    assert found is not None
    return found


@pytest.mark.parametrize("width", [1, 2, 7, 10, 11])
def test_the_width_of_a_gap_is_exact(width: int) -> None:
    place = _narrowest(_rooms((20, width)))
    assert place.width_m == pytest.approx(0.05 * width)
    assert place.needed_m == place.turning_m == pytest.approx(0.60 + SPARE_M)
    assert 2.1 < place.at[0] < 2.3  # in the wall, which is 2.1 to 2.3 m
    assert abs(place.at[1] - (1.0 + 0.025 * width)) <= 0.025 + 1e-9  # in its middle, to half a cell
    assert sorted(place.sides[:, 1]) == pytest.approx([1.0, 1.0 + 0.05 * width])


def test_of_two_gaps_the_wider_is_named_though_it_is_farther() -> None:
    place = _narrowest(_rooms((28, 6), (4, 9)))
    assert place.width_m == pytest.approx(0.45)
    assert 0.2 < place.at[1] < 0.65


def test_of_two_gaps_one_behind_the_other_the_narrower_is_named() -> None:
    cells = _rooms((20, 11))
    cells[:, 60:62] = OCCUPIED
    cells[35:43, 60:62] = FREE
    place = _narrowest(cells)
    assert place.width_m == pytest.approx(0.40)
    assert 3.0 < place.at[0] < 3.1


def test_the_reason_says_where_how_wide_and_what_the_robot_needs() -> None:
    assert _refused(_rooms((20, 10))).reason == (
        "start and goal lie in separate regions, of 3.4 and 3.4 m2; a robot of less radius than"
        " 0.3 m could do it; the narrowest place on the widest way is at (2.12, 1.23), 0.50 m wide;"
        " the robot needs 0.68 m"
    )


def test_a_gap_oblique_to_the_cells_is_measured_straight_across() -> None:
    cells = np.full((60, 88), FREE, np.uint8)
    rows, columns = np.indices(cells.shape)
    across = (rows - 30) - (columns - 44)  # a wall from corner to corner
    cells[np.abs(across) <= 3] = OCCUPIED
    along = (rows - 30) + (columns - 44)
    cells[(np.abs(across) <= 3) & (np.abs(along) <= 9)] = FREE
    grid = Grid((0.0, 0.0), 0.05, cells)
    found = plan_path(costmap(grid, 0.0, CONFIG), (1.0, 2.5), (3.4, 0.5))
    assert isinstance(found, NoPath)
    assert found.narrowest is not None
    # cells at along = -10 and +10 are (5, 5) or (4, 6) apart to each side: 9 x 9 free between
    assert found.narrowest.width_m == pytest.approx(0.05 * np.hypot(9, 9))


def test_the_map_s_uncertainty_is_part_of_what_is_needed() -> None:
    costs = costmap(Grid((0.0, 0.0), 0.05, _rooms((20, 10))), 0.04, CONFIG)
    found = plan_path(costs, *ENDS)
    assert isinstance(found, NoPath)
    assert found.narrowest is not None
    assert found.narrowest.needed_m == pytest.approx(0.68 + SPARE_M)


@pytest.mark.parametrize("width", range(1, 20))
def test_a_gap_as_wide_as_is_needed_has_a_path(width: int) -> None:
    costs = costmap(Grid((0.0, 0.0), 0.05, _rooms((20, width))), 0.0, CONFIG)
    found = plan_path(costs, *ENDS)
    if isinstance(found, Plan):
        assert 0.05 * width > 0.60
    else:
        assert found.narrowest is not None
        assert found.narrowest.width_m < found.narrowest.needed_m


def test_a_place_with_an_obstacle_on_one_side_tells_the_distance() -> None:
    """Beyond its other side nobody saw anything; a gap behind it is too narrow, but wider."""
    cells = _rooms((20, 2))
    cells[22:59, 42:46] = UNKNOWN
    cells[:, 60:62] = OCCUPIED
    cells[35:43, 60:62] = FREE
    found = _refused(cells)
    assert found.narrowest is not None
    assert found.narrowest.sides == pytest.approx(np.array([[2.125, 1.0]]))
    assert found.narrowest.width_m == pytest.approx(0.075)  # from the second row's centre
    assert found.narrowest.needed_m == pytest.approx(0.30 + SPARE_M / 2)
    assert found.reason.endswith("(2.12, 1.07), 0.07 m beside an obstacle; the robot needs 0.34 m")


def test_an_end_that_may_be_moved_is_not_the_narrowest_place() -> None:
    """The start is 0.1 m from a wall: the robot cannot stand there, but moves it."""
    costs = costmap(Grid((0.0, 0.0), 0.05, _rooms((20, 10))), 0.0, CONFIG)
    found = plan_path(costs, (0.15, 1.5), ENDS[1])
    assert isinstance(found, NoPath)
    assert found.narrowest is not None
    assert found.narrowest.width_m == pytest.approx(0.50)


@pytest.mark.parametrize("seed", range(8))
def test_no_way_is_wider_than_the_widest(seed: int) -> None:
    """Held against the largest clearance at which cells are still joined."""
    rng = np.random.default_rng(seed)
    cells = np.full((50, 70), FREE, np.uint8)
    for row, column in rng.integers(0, 65, (45, 2)):
        cells[row : row + 2, column : column + 3] = OCCUPIED
    grid = Grid((0.0, 0.0), 0.05, cells)
    point = costmap(grid, 0.0, PlanConfig(robot_radius_m=0.0))
    wide = costmap(grid, 0.0, PlanConfig(robot_radius_m=50.0))
    regions, _ = ndimage.label(cells == FREE)
    joined = np.argwhere(regions == np.bincount(regions[regions > 0]).argmax())
    ends = joined[rng.integers(len(joined), size=(2, 1))]
    place = narrowest_place(point, wide, *ends)
    assert place is not None
    first, last = (tuple(end[0]) for end in ends)

    def joins(clearance_m: float) -> bool:
        labels, _ = ndimage.label(point.clearance_m >= clearance_m)
        return bool(labels[first] > 0 and labels[first] == labels[last])

    row, column = grid.cells_at(place.at)
    assert joins(point.clearance_m[row, column])
    assert not joins(point.clearance_m[row, column] + 1e-9)


def test_where_nothing_leads_through_no_gap_is_told() -> None:
    refused = _refused(_rooms())
    assert refused.narrowest is None
    assert refused.reason == "start and goal lie in separate regions, of 3.3 and 3.3 m2"


def test_where_unknown_space_is_the_wall_that_is_said_and_no_gap() -> None:
    refused = _refused(_rooms(wall=UNKNOWN))
    assert refused.narrowest is None
    assert refused.reason.endswith("; there is a way through unknown space (--allow-unknown)")


def test_where_a_zone_is_the_wall_that_is_said_and_no_gap() -> None:
    rug = np.array([(2.0, 0.0), (2.5, 0.0), (2.5, 3.0), (2.0, 3.0)])
    refused = _refused(_rooms((20, 20)), Zones({"rug": rug}))
    assert refused.narrowest is None
    assert refused.reason.endswith("; the keep-out 'rug' is in the way")


def test_a_gap_that_a_one_way_leads_against_is_no_way() -> None:
    against = OneWay(np.array([(2.0, 0.9), (2.4, 0.9), (2.4, 1.7), (2.0, 1.7)]), np.pi)
    gaps = _rooms((20, 11), (40, 8))
    assert _narrowest(gaps).width_m == pytest.approx(0.55)
    place = _refused(gaps, Zones(one_way={"gate": against})).narrowest
    assert place is not None
    assert place.width_m == pytest.approx(0.40)


def test_where_a_zone_and_unknown_space_both_bar_the_way_both_are_said() -> None:
    rug = np.array([(1.8, 0.0), (2.0, 0.0), (2.0, 3.0), (1.8, 3.0)])
    refused = _refused(_rooms(wall=UNKNOWN), Zones({"rug": rug}))
    assert refused.reason.endswith(
        "; there is a way through unknown space (--allow-unknown), without 'rug'"
    )


def test_a_gap_beyond_unknown_space_is_told_too() -> None:
    cells = _rooms((20, 6))
    cells[:, 46:50] = UNKNOWN
    refused = _refused(cells)
    assert (
        "; a robot of less radius than 0.3 m could do it through unknown space;" in refused.reason
    )
    assert refused.narrowest is not None
    assert refused.narrowest.width_m == pytest.approx(0.30)


def test_of_a_footprint_it_is_told_what_it_needs_to_pass_and_to_turn() -> None:
    long = "0.5,0.2 -0.5,0.2 -0.5,-0.2 0.5,-0.2"
    grid = Grid((0.0, 0.0), 0.05, _rooms((20, 6)))
    found = plan_path(costmap(grid, 0.0, PlanConfig(footprint=long)), *ENDS)
    assert isinstance(found, NoPath)
    # 0.4 m and 2 x 0.539 m, each and a cell's diagonal of 0.071 m
    assert found.reason.endswith(
        "; a smaller robot could do it; the narrowest place on the widest way is at (2.12, 1.12),"
        " 0.30 m wide; the robot needs 0.48 m to pass straight and 1.15 m to turn"
    )
