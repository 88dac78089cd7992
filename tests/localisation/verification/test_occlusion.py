import numpy as np
import pytest

from vnav.core import se3
from vnav.core.voxels import Voxels
from vnav.localisation.verification.occlusion import START_M, SURFACE_M, SURFACE_SHARE, occluded
from vnav.localisation.view import View


@pytest.fixture
def wall() -> Voxels:
    """A wall across x = 2 m, 5 cm thick, from y = -1 to 1 m, as high; a floor at z = 0."""
    across = [(2.025, y, z) for y in np.arange(-0.975, 1, 0.05) for z in np.arange(0.025, 2, 0.05)]
    floor = [(x, y, -0.025) for x in np.arange(-1, 5, 0.05) for y in np.arange(-2, 2, 0.05)]
    cubes = np.array(across + floor)
    return Voxels.filled(cubes, np.full(len(cubes), 0.05), 0.05)


def view_from(world, position) -> View:
    return View(se3.inverse(world.looking(position, 0.0)), world.camera)


def test_what_stands_behind_a_wall_is_hidden(world, wall):
    behind, beside = [4.0, 0.0, 1.0], [4.0, 2.5, 1.0]
    found = occluded(view_from(world, (0.0, 0.0, 1.0)), np.array([behind, beside]), wall)
    assert found.tolist() == [True, False]


def test_what_is_on_the_wall_is_seen(world, wall):
    """The voxel a landmark lies in does not hide it, also at a grazing angle on the floor."""
    on_wall, on_floor = [2.0, 0.3, 1.5], [1.9, 0.5, 0.0]
    view = view_from(world, (-1.5, 0.0, 1.2))
    assert not occluded(view, np.array([on_wall, on_floor]), wall).any()


def test_a_camera_inside_a_wall_sees_nothing_beyond_it(world):
    """One that stands in something as thick as itself."""
    block = Voxels.filled([[0.0, 0.0, 1.0]], [0.8], 0.05)
    landmarks = np.array([[3.0, y, 1.0] for y in np.linspace(-1, 1, 9)])
    assert occluded(view_from(world, (0.0, 0.0, 1.0)), landmarks, block).all()


def test_where_nothing_is_known_nothing_is_hidden(world):
    nothing = Voxels.filled(np.zeros((0, 3)), np.zeros(0), 0.05)
    assert not occluded(view_from(world, (0, 0, 1)), np.array([[4.0, 0.0, 1.0]]), nothing).any()
    assert occluded(view_from(world, (0, 0, 1)), np.zeros((0, 3)), nothing).shape == (0,)


def test_what_is_hidden_is_what_samples_of_the_whole_way_tell(world):
    """Boxes at random, looked at from inside and outside of where they stand."""
    rng = np.random.default_rng(0)
    cubes = np.rint(rng.uniform(-40, 40, (400, 3))) * 0.05
    voxels = Voxels.filled(cubes, 0.1 * rng.integers(1, 4, 400), 0.05)
    points = rng.uniform(-2.5, 2.5, (500, 3))
    for position in ((0.31, 0.12, 0.23), (-4.1, 0.3, 3.2)):
        way = points - position
        distance = np.linalg.norm(way, axis=1)
        blocked = np.zeros(500, bool)
        for at in np.arange(START_M, 10, 0.05):
            stands = voxels.stands_at(position + way * (at / distance)[:, None])
            blocked |= stands & (at < distance * (1 - SURFACE_SHARE) - SURFACE_M)
        assert 50 < blocked.sum() < 450
        np.testing.assert_array_equal(occluded(view_from(world, position), points, voxels), blocked)
