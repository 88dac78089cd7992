import dataclasses

import numpy as np
import pytest
from numpy.typing import NDArray

from vnav.config import FuseConfig
from vnav.core.grid import FREE, OCCUPIED, UNKNOWN, Grid
from vnav.errors import MapError
from vnav.planning.projection import project

CONFIG = FuseConfig(octree_m=0.05, obstacle_min_m=0.10, robot_height_m=1.40, free_height_m=0.15)
Voxel = tuple[float, float, float, bool]  # column, row and layer of a voxel, whether occupied
FLOOR: Voxel = (0, 0, 0, True)


def _grid(*voxels: Voxel, edge: int = 1, config: FuseConfig = CONFIG) -> Grid:
    """Project voxels whose centres lie half a voxel above their column, row and layer."""
    table = np.array(voxels, float).reshape(-1, 4)
    centres = (table[:, :3] + edge / 2) * config.octree_m
    size_m = np.full(len(table), edge * config.octree_m)
    return project(centres, table[:, 3] > 0, size_m, config)


def _state(*voxels: Voxel, config: FuseConfig = CONFIG) -> int:
    """What becomes of the cell at the origin, between two cells of floor."""
    return int(_grid((-1, 0, 0, True), (1, 0, 0, True), *voxels, config=config).cells[0, 1])


@pytest.mark.parametrize("layer", [-2, -1, 0, 1])
def test_floor_within_its_noise_is_free(layer: int) -> None:
    # layers -2 to 1 reach from 0.10 m below to 0.10 m above: 3 sigma of depth noise at 4 m
    assert _state((0, 0, layer, True)) == FREE


@pytest.mark.parametrize("layer", [2, 3, 15, 27])
def test_an_obstacle_from_ankle_to_head_is_occupied(layer: int) -> None:
    assert _state(FLOOR, (0, 0, layer, True)) == OCCUPIED


def test_a_low_obstacle_is_kept_although_the_floor_below_it_was_seen() -> None:
    assert _state(FLOOR, (0, 0, 1, False), (0, 0, 2, True)) == OCCUPIED


def test_what_hangs_above_the_robot_is_no_obstacle() -> None:
    assert _state(FLOOR, (0, 0, 29, True)) == FREE


def test_a_surface_that_touches_the_robots_height_is_an_obstacle() -> None:
    assert _state(FLOOR, (0, 0, 28, True)) == OCCUPIED


def test_the_lower_limit_is_decided_by_the_centre_of_a_voxel_that_straddles_it() -> None:
    lower = dataclasses.replace(CONFIG, obstacle_min_m=0.12)  # layer 2 has its centre at 0.125
    higher = dataclasses.replace(CONFIG, obstacle_min_m=0.13)
    assert _state((0, 0, 2, True), config=lower) == OCCUPIED
    assert _state((0, 0, 2, True), config=higher) == FREE


def test_free_voxels_close_to_the_floor_are_free() -> None:
    assert _state((0, 0, 2, False)) == FREE


def test_a_ray_that_passed_high_up_frees_nothing() -> None:
    assert _state((0, 0, 20, False)) == UNKNOWN


def test_where_one_sees_below_the_floor_it_drops_and_that_is_occupied() -> None:
    assert _state((0, 0, 1, False), (0, 0, -3, False)) == OCCUPIED  # layer -3 is 0.125 m deep
    assert _state((0, 0, 1, False), (0, 0, -2, False)) == FREE  # as deep as noise
    assert _state((0, 0, 1, False), (0, 0, -6, False)) == FREE  # below the slab: a room there


def test_floor_that_was_seen_does_not_drop_however_deep_a_ray_went() -> None:
    assert _state((0, 0, -1, True), (0, 0, -3, False)) == FREE


def test_depths_beside_all_floor_are_no_part_of_the_grid() -> None:
    grid = _grid((0, 0, 0, True), (1, 0, 0, True), (-3, 0, -5, False), (4, 2, -5, False))
    assert grid.cells.tolist() == [[FREE, FREE]]


def test_what_lies_far_below_the_floor_is_no_floor() -> None:
    assert _state((0, 0, -5, True)) == UNKNOWN


def test_a_cell_that_nothing_was_seen_of_is_unknown() -> None:
    assert _grid((0, 0, 0, True), (2, 0, 0, True)).cells.tolist() == [[FREE, UNKNOWN, FREE]]


@pytest.mark.parametrize(("occupied", "state"), [(True, OCCUPIED), (False, FREE)])
def test_a_large_leaf_stands_for_all_the_voxels_it_holds(occupied: bool, state: int) -> None:
    grid = _grid((-4, 8, 0, occupied), edge=4)
    assert grid.cells.tolist() == [[state] * 4] * 4
    assert grid.origin == (-0.2, 0.4)


def test_a_large_leaf_counts_by_the_voxels_in_the_band_not_by_its_centre() -> None:
    # 1.6 m high, from 1.2 m: only its lowest voxels are within the robot's height
    state = _grid((0, 0, 24, True), edge=32).cells[0, 0]
    assert state == OCCUPIED


def test_leaves_land_where_a_plain_loop_puts_their_voxels() -> None:
    rng = np.random.default_rng(0)
    expected = np.full((40, 40), UNKNOWN)
    centres, occupied, size_m = _random_leaves(rng, 60)
    for full, state in ((False, FREE), (True, OCCUPIED)):  # obstacles win, so they come last
        for centre, size in zip(centres[occupied == full], size_m[occupied == full], strict=True):
            x, y = np.rint((centre[:2] - size / 2) / 0.05).astype(int)
            n = round(size / 0.05)
            expected[y : y + n, x : x + n] = state
    grid = project(centres, occupied, size_m, CONFIG)
    column, row = np.rint(np.array(grid.origin) / 0.05).astype(int)
    rows, columns = grid.cells.shape
    inside = expected[row : row + rows, column : column + columns]
    np.testing.assert_array_equal(grid.cells, inside)
    assert (expected != UNKNOWN).sum() == (inside != UNKNOWN).sum()


def _random_leaves(
    rng: np.random.Generator, count: int
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64]]:
    """Leaves within 2 m x 2 m whose lowest voxel begins 0.10 m above the floor."""
    edges = rng.choice([1, 2, 4], count)
    corners = np.column_stack([rng.integers(0, 36, (count, 2)), np.full(count, 2)])
    return (corners + edges[:, None] / 2) * 0.05, rng.random(count) < 0.5, edges * 0.05


def test_without_leaves_there_is_an_error_and_no_empty_grid() -> None:
    with pytest.raises(MapError, match="found none in 0 leaves"):
        _grid()


def test_leaves_that_say_nothing_about_floor_or_obstacles_are_an_error() -> None:
    with pytest.raises(MapError, match="found none in 2 leaves"):
        _grid((0, 0, 40, True), (0, 0, 30, False))
