import numpy as np
import pytest

from vnav.core.voxels import FARTHEST, Voxels


@pytest.fixture
def voxels() -> Voxels:
    """One voxel of 0.1 m at 1.05, 2.05, 0.05 and a cube of eight next to it."""
    return Voxels.filled([[1.05, 2.05, 0.05], [1.2, 2.2, 0.2]], [0.1, 0.2], 0.1)


def test_a_cube_fills_the_voxels_it_is_made_of(voxels: Voxels) -> None:
    assert voxels.solid.shape == (3, 3, 3)
    assert voxels.solid.sum() == 1 + 8


def test_something_stands_in_a_cube_and_not_beside_it(voxels: Voxels) -> None:
    points = np.array([[1.01, 2.09, 0.05], [1.11, 2.11, 0.29], [1.05, 2.05, 0.15]])
    assert voxels.stands_at(points).tolist() == [True, True, False]


def test_outside_of_what_is_known_nothing_stands(voxels: Voxels) -> None:
    assert not voxels.stands_at(np.array([[0.95, 2.05, 0.05], [9, 9, 9], [-9, -9, -9]])).any()


def test_without_cubes_nothing_stands_anywhere() -> None:
    empty = Voxels.filled(np.zeros((0, 3)), np.zeros(0), 0.05)
    assert not empty.stands_at(np.zeros((2, 3))).any()


def test_it_is_told_how_far_away_something_stands_along_the_axis_on_which_it_is_most() -> None:
    rng = np.random.default_rng(0)
    cells = rng.integers(0, 30, (5, 3))
    voxels = Voxels.filled((cells + 0.5) * 0.1, np.full(5, 0.1), 0.1)
    cells -= cells.min(0)
    every = np.moveaxis(np.indices(voxels.away.shape), 0, -1)
    distance = np.abs(every[..., None, :] - cells).max(-1).min(-1)
    np.testing.assert_array_equal(voxels.away, distance)


def test_what_is_far_away_is_at_least_as_far_as_told() -> None:
    voxels = Voxels.filled([[0.05, 0.05, 0.05], [9.95, 0.05, 0.05]], [0.1, 0.1], 0.1)
    assert voxels.away.max() == FARTHEST
    cells = np.array([[-7, 0, 0], [50, 0, 0], [4, -3, 9], [104, 0, 2]]).T
    assert voxels.away_from(cells).tolist() == [7, FARTHEST, 9, 5]
