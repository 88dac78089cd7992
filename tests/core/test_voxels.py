import numpy as np
import pytest

from vnav.core.voxels import Voxels


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
