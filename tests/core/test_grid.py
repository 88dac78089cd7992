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
