import numpy as np
import pytest

from vnav.core.grid import FREE, OCCUPIED, UNKNOWN, Grid

GRID = Grid((-1.0, 2.0), 0.5, np.array([[FREE, FREE, OCCUPIED], [UNKNOWN, FREE, FREE]], np.uint8))


def test_rows_run_along_y_and_columns_along_x() -> None:
    np.testing.assert_array_equal(GRID.cells_at([-0.9, 2.6]), [1, 0])
    np.testing.assert_array_equal(GRID.cells_at([0.4, 2.1]), [0, 2])


def test_the_centre_of_a_cell_lies_in_it() -> None:
    cells = np.argwhere(GRID.cells >= 0)
    np.testing.assert_array_equal(GRID.cells_at(GRID.centres_of(cells)), cells)
    np.testing.assert_allclose(GRID.centres_of([0, 0]), [-0.75, 2.25])


def test_a_point_off_the_grid_has_a_cell_that_is_not_contained() -> None:
    outside = GRID.cells_at([[-1.1, 2.1], [0.6, 2.1], [0.0, 3.1], [0.0, 1.9]])
    assert not GRID.contains(outside).any()
    assert GRID.contains(GRID.cells_at([0.0, 2.1]))


def test_areas_are_of_the_floor() -> None:
    assert GRID.area_m2(FREE) == pytest.approx(4 * 0.25)
    assert GRID.area_m2(OCCUPIED) == pytest.approx(0.25)


def test_cells_cannot_be_written() -> None:
    with pytest.raises(ValueError, match="read-only"):
        GRID.cells[0, 0] = OCCUPIED


def test_a_polygon_occupies_what_it_holds_and_what_its_edges_touch() -> None:
    grid = Grid((-1.0, 2.0), 0.1, np.full((40, 50), FREE, np.uint8))
    hook = [(0.0, 3.0), (2.0, 3.0), (2.0, 5.0), (1.8, 5.0), (1.8, 3.2), (0.0, 3.2)]
    cells = grid.blocked([hook]).cells
    points = {(1.0, 3.1): OCCUPIED, (1.9, 4.5): OCCUPIED, (1.0, 4.0): FREE, (2.5, 3.1): FREE}
    for point, state in points.items():
        assert cells[tuple(grid.cells_at(point))] == state, point


def test_a_polygon_thinner_than_a_cell_is_a_wall_without_gaps() -> None:
    grid = Grid((0.0, 0.0), 0.1, np.full((30, 30), FREE, np.uint8))
    cells = grid.blocked([[(0.51, 0.02), (0.52, 0.02), (2.51, 2.98)]]).cells
    assert (cells == OCCUPIED).any(1).all()
    assert (cells == OCCUPIED).sum() < 90


def test_a_polygon_may_reach_beyond_the_grid_or_lie_outside() -> None:
    grid = Grid((0.0, 0.0), 0.1, np.full((10, 10), FREE, np.uint8))
    assert (grid.blocked([[(-5, -5), (5, -5), (5, 5), (-5, 5)]]).cells == OCCUPIED).all()
    assert (grid.blocked([[(7, 7), (8, 7), (8, 8)]]).cells == FREE).all()
