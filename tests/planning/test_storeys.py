"""Two rooms one above the other, by exact depth at exact poses: a grid of each floor."""

import numpy as np
import pytest

from vnav.config import FuseConfig
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.grid import FREE, OCCUPIED, Grid
from vnav.planning.projection import project
from vnav.planning.storeys import is_over_floor, other_floor
from vnav.synthetic import SCENES
from vnav.synthetic.path import Hand, walk
from vnav.synthetic.storeys import FOOT_M, HEAD_M, STAIR_M, STOREY_M
from vnav.volumes.octree import Scans

CAMERA = Intrinsics(80, 60, 65.0, 65.0, 39.5, 29.5)
FRAMES, HELD_M = 90, 1.3
CONFIG = FuseConfig(max_range_m=8.0)


@pytest.fixture(scope="module")
def cameras() -> np.ndarray:
    """Poses (N, 4, 4) below, on the stair and above, looking down by 25 degrees."""
    scene = SCENES["two_storeys"](0)
    hand = Hand(HELD_M, -25.0)
    return walk(np.array(scene.tour), FRAMES, hand, np.random.default_rng(0))


@pytest.fixture(scope="module")
def scans(cameras: np.ndarray) -> list[np.ndarray]:
    """What each camera sees, exactly: points (M, 3)."""
    scene, v_u = SCENES["two_storeys"](0), np.indices((CAMERA.height, CAMERA.width))
    found = []
    for T in cameras:
        depth_m = scene.render_depth(CAMERA, T)
        seen = depth_m > 0
        px = np.stack([v_u[1][seen], v_u[0][seen]], -1)
        found.append(se3.transform(T, CAMERA.unproject(px, depth_m[seen].astype(float))))
    return found


def grid_at(floor_m: float, cameras: np.ndarray, scans: list[np.ndarray]) -> Grid:
    octree = Scans(CONFIG.octree_m)
    for points, T in zip(scans, cameras, strict=True):
        octree.insert(points, T[:3, 3])
    leaves = octree.octree().most_likely.leaves()
    down = np.array([0, 0, -floor_m])
    return project(leaves.centres_world + down, leaves.occupied, leaves.size_m, CONFIG)


def states(grid: Grid, x: float, y: float) -> set[int]:
    """Of the cells within 0.15 m of a place."""
    row, column = grid.cells_at((x, y)).tolist()
    return set(grid.cells[row - 2 : row + 3, column - 2 : column + 3].ravel().tolist())


def test_the_other_floor_is_found_from_either(cameras: np.ndarray, scans: list[np.ndarray]) -> None:
    points = np.concatenate(scans)
    # Depth is exact; a band of heights is 2 cm wide.
    assert other_floor(cameras[:, :3, 3], points, 0.0) == pytest.approx(STOREY_M, abs=0.02)
    assert other_floor(cameras[:, :3, 3], points, STOREY_M) == pytest.approx(0.0, abs=0.02)


def test_cameras_of_one_storey_tell_of_no_other(
    cameras: np.ndarray, scans: list[np.ndarray]
) -> None:
    below = cameras[cameras[:, 2, 3] < 2.0, :3, 3]
    assert len(below) > 20
    assert other_floor(below, np.concatenate(scans), 0.0) is None
    assert other_floor(np.full((5, 3), np.nan), np.zeros((0, 3)), 0.0) is None


def test_above_the_stair_the_floor_drops_and_beside_it_it_is_free(
    cameras: np.ndarray, scans: list[np.ndarray]
) -> None:
    above = grid_at(STOREY_M, cameras, scans)
    middle = (FOOT_M + HEAD_M) / 2
    assert states(above, middle, STAIR_M / 2) == {OCCUPIED}
    assert states(above, middle, STAIR_M + 0.6) == {FREE}


def test_a_grid_has_nothing_of_the_other_storey(
    cameras: np.ndarray, scans: list[np.ndarray]
) -> None:
    below, above = (grid_at(floor_m, cameras, scans) for floor_m in (0.0, STOREY_M))
    table_above, sofa_below = (6.3, 3.9), (0.6, 2.6)
    assert OCCUPIED in states(above, *table_above)
    assert OCCUPIED not in states(below, *table_above)
    assert OCCUPIED in states(below, *sofa_below)
    assert OCCUPIED not in states(above, *sofa_below)


def test_a_camera_in_a_hand_is_over_its_floor_and_no_other() -> None:
    heights_m = (-STOREY_M + 1.3, -1.0, 0.1, 1.3, 2.1, STOREY_M + 0.2)
    assert [is_over_floor(h) for h in heights_m] == [False, False, True, True, True, False]
