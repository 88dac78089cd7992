"""Grids that are drawn, cells of 10 cm, and cameras that are carried over them."""

import dataclasses

import numpy as np
import pytest

from vnav.config import FuseConfig
from vnav.core.arrays import Array
from vnav.core.grid import FREE, OCCUPIED, UNKNOWN, WALKED, Grid
from vnav.planning.walked import add_walked

CELL_M, RADIUS_M, HELD_M = 0.1, 0.25, 1.3
CONFIG = FuseConfig(octree_m=CELL_M, walked_radius_m=RADIUS_M)
LETTERS = {".": FREE, "#": OCCUPIED, "?": UNKNOWN}
NOTHING = np.zeros((0, 3), np.float32)


def _grid(*rows: str) -> Grid:
    """A grid from a drawing whose last line is the first row; its corner is at (-1, 2)."""
    cells = [[LETTERS[letter] for letter in row] for row in rows[::-1]]
    return Grid((-1.0, 2.0), CELL_M, np.array(cells, np.uint8))


def _along(row: float, first: float, last: float, height_m: float = HELD_M) -> Array:
    """A camera that is carried along a row from one column to another, 5 cm a frame."""
    count = 1 + round(abs(last - first) * CELL_M / 0.05)
    column = np.linspace(first, last, count)
    x, y = -1 + (column + 0.5) * CELL_M, np.full(count, 2 + (row + 0.5) * CELL_M)
    return np.column_stack([x, y, np.full(count, height_m)])


def _walked(grid: Grid, *paths: Array, points: Array = NOTHING) -> list[tuple[int, int]]:
    """Row and column of those cells of the grid that somebody walked."""
    found = add_walked(grid, paths, points, CONFIG)
    cells = np.argwhere(np.ones(grid.cells.shape))
    states = found.cells[tuple(found.cells_at(grid.centres_of(cells)).T)]
    return [(r, c) for r, c in cells[states == WALKED].tolist()]


HALL = _grid("." * 5 + "?" * 30 + "." * 5)  # a strip whose middle nobody saw


def test_unknown_cells_near_the_path_are_walked_and_all_others_stay() -> None:
    rng = np.random.default_rng(0)
    cells = np.full((40, 60), UNKNOWN, np.uint8)
    cells[:, :20] = rng.choice([FREE, UNKNOWN], (40, 20))
    cells[0] = cells[-1] = cells[:, 0] = cells[:, -1] = OCCUPIED
    grid, path = Grid((-1.0, 2.0), CELL_M, cells), _along(20.3, 10, 50)
    found = add_walked(grid, [path], NOTHING, CONFIG)
    rows, columns = np.indices(cells.shape)
    beyond = np.maximum(0, np.maximum(10 - columns, columns - 50))
    away_m = CELL_M * np.hypot(rows - 20.3, beyond)
    expected = np.where((cells == UNKNOWN) & (away_m < RADIUS_M), WALKED, cells)
    np.testing.assert_array_equal(found.cells, expected)
    assert (found.cells == WALKED).sum() > 100


def test_a_hall_between_seen_floor_is_walked() -> None:
    assert _walked(HALL, _along(0, 1, 38)) == [(0, column) for column in range(5, 35)]


def test_a_capture_that_begins_on_unseen_floor_has_walked_there() -> None:
    assert _walked(HALL, _along(0, 20, 38))[0] == (0, 18)  # 0.2 m before the first frame


def test_no_occupied_cell_is_walked_nor_a_stretch_that_leads_over_one() -> None:
    # A counter whose front was seen, and whose top and back were not.
    counter = _grid("....???#???....????....")
    assert _walked(counter, _along(0, 1, 21)) == [(0, column) for column in range(15, 19)]


def test_a_stretch_beside_something_is_walked_up_to_it() -> None:
    beside = _grid("....????....", "....????....", "....####....")
    walked = _walked(beside, _along(1.4, 1, 10))
    assert walked == [(row, column) for row in (1, 2) for column in range(4, 8)]


@pytest.mark.parametrize("height_m", [0.4, -0.5])
def test_where_depth_shows_something_lower_than_the_robot_nobody_walked(height_m: float) -> None:
    """A box that the octree does not have occupied; a tread of a stair that leads down."""
    shown = np.array([[-1 + 20.5 * CELL_M, 2.05, height_m]])
    assert _walked(HALL, _along(0, 1, 38), points=shown) == []
    beside = _grid(*["." * 5 + "?" * 30 + "." * 5] * 2)
    walked = _walked(beside, _along(1.4, 1, 38), points=shown)
    assert set(walked) == {(r, c) for r in (0, 1) for c in range(5, 35)} - {(0, 20)}


def test_what_hangs_above_the_robot_does_not_matter() -> None:
    lamp = np.array([[-1 + 20.5 * CELL_M, 2.05, CONFIG.robot_height_m + 0.1]])
    assert len(_walked(HALL, _along(0, 1, 38), points=lamp)) == 30


def test_a_camera_put_down_on_something_unseen_was_not_walked_there() -> None:
    path = _along(0, 1, 38)
    path[60:, 2] = 0.75
    assert _walked(HALL, path[:65]) == []


def test_a_camera_that_climbs_a_stair_was_not_walked_there() -> None:
    path = _along(0, 1, 38)
    path[40:, 2] += 0.17 * np.arange(1, len(path) - 39) // 0.3 * 0.3
    assert _walked(HALL, path[:60]) == []


def test_a_camera_higher_than_anybody_holds_one_was_not_walked() -> None:
    assert _walked(HALL, _along(0, 1, 38, height_m=3.2)) == []


@pytest.mark.parametrize("lost", [np.nan, 0.0])
def test_an_unseen_stretch_with_frames_missing_is_not_walked(lost: float) -> None:
    """Frames without a pose, or none at all: nobody knows where the camera was."""
    path = _along(0, 1, 38)
    path[30:45] = np.nan
    path = path if np.isnan(lost) else path[np.isfinite(path[:, 0])]
    assert _walked(HALL, path) == []


def test_a_few_frames_missing_do_not_matter() -> None:
    path = _along(0, 1, 38)
    path[30:36] = np.nan
    assert len(_walked(HALL, path)) == 30


def test_captures_are_not_joined_to_each_other() -> None:
    first, second = _along(0, 1, 8), _along(0, 20, 38)
    parts = [(0, column) for column in (*range(5, 11), *range(18, 35))]  # 0.2 m beyond their ends
    assert _walked(HALL, first, second) == parts
    assert _walked(HALL, np.concatenate([first, second])) == []


def test_the_grid_gets_room_for_what_was_walked_outside_it() -> None:
    grid = _grid("......", "......")
    found = add_walked(grid, [_along(1, 3, -6)], NOTHING, CONFIG)
    row, column = found.cells_at(grid.centres_of((0, 0)))
    assert found.origin == pytest.approx((-1 - CELL_M * column, 2 - CELL_M * row), abs=1e-9)
    np.testing.assert_array_equal(found.cells[row : row + 2, column:], grid.cells)
    around = found.cells_at([(-1.3, 2.15), (-1.3, 2.35), (-1.75, 2.15), (-1.3, 1.85)])
    assert [found.cells[tuple(c)] for c in around] == [WALKED] * 4
    assert all((found.cells[edge] == WALKED).any() for edge in (0, -1))


def test_where_nobody_walked_the_grid_stays_as_it_is() -> None:
    for walks in [], [np.zeros((0, 3))], [np.full((3, 3), np.nan)], [_along(0, 20, 20)]:
        found = add_walked(HALL, walks, NOTHING, CONFIG)
        assert (found.origin, found.cells.tobytes()) == (HALL.origin, HALL.cells.tobytes())
    narrow = dataclasses.replace(CONFIG, walked_radius_m=0.0)
    found = add_walked(HALL, [_along(0, -9, 38)], NOTHING, narrow)
    assert (found.origin, found.cells.tobytes()) == (HALL.origin, HALL.cells.tobytes())
