from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from vnav.core import se3
from vnav.core.grid import OCCUPIED
from vnav.core.point_cloud import Mesh
from vnav.synthetic import Box, Scene
from vnav.synthetic.raycast import Rectangles
from vnav.volumes.octree import Leaves, Octree, Scans

CELL_M = 0.05


@pytest.fixture(scope="module")
def people(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("people")


@pytest.fixture(scope="module")
def block() -> Scene:
    """A cube of one metre in the middle of a space of five."""
    cube = Box((2.5, 2.5, 0.5), (1.0, 1.0, 1.0), 0.0, "plaster")
    return Scene(((cube,),), (0, 0, 5, 5, 2.5), (), 0)


def octree_of(points: np.ndarray) -> Octree:
    scans = Scans(CELL_M)
    scans.insert(points, np.array([2.5, 0.2, 1.2]))
    return scans.octree()


def square(x: float, y: float, z: float, size_m: float) -> np.ndarray:
    """Points of a square that stands upright and faces along y, one in each cell."""
    side = np.arange(CELL_M / 2, size_m, CELL_M)
    across, up = np.meshgrid(side, side)
    return np.stack([x + across, np.full_like(across, y), z + up], -1).reshape(-1, 3)


def test_the_distance_is_to_the_nearest_point_of_a_rectangle(people: ModuleType) -> None:
    unit = Rectangles(np.zeros((1, 3)), np.array([[2.0, 0, 0]]), np.array([[0, 1.0, 0]]))
    points = np.array([[1, 0.5, 0.3], [1, 0.5, -0.3], [-3, 0.5, 4], [5, 2, 0], [2, 1, 0.0]])
    expected = [0.3, 0.3, 5, np.sqrt(10), 0]
    np.testing.assert_allclose(people.distance_m(points, unit), expected, atol=1e-12)
    assert people.distance_m(np.zeros((0, 3)), unit).shape == (0,)


def test_a_large_leaf_is_as_many_cells_as_fit_into_it(people: ModuleType) -> None:
    centres = np.array([[0.1, 0.1, 0.1], [0.325, 0.025, 0.025], [0.425, 0.025, 0.025]])
    leaves = Leaves(centres, np.array([True, True, False]), np.array([0.2, 0.05, 0.05]))
    cells = people.occupied_cells(leaves, CELL_M)
    assert len(np.unique(cells.round(6), axis=0)) == 4**3 + 1
    assert cells[cells[:, 0] < 0.2].max() == pytest.approx(0.175)


def test_cells_of_a_true_surface_are_no_ghosts_and_those_in_the_air_are(
    people: ModuleType, block: Scene
) -> None:
    surface, air = square(2.0, 2.0, 0.0, 1.0), square(2.0, 1.0, 1.2, 0.5)
    assert people.ghost_cells(octree_of(surface), np.eye(4), block) == 0
    both = octree_of(np.concatenate([surface, air]))
    assert people.ghost_cells(both, np.eye(4), block) == len(air)


def test_ghosts_are_counted_in_the_true_world(people: ModuleType, block: Scene) -> None:
    """A map whose world lies a metre off is brought back first."""
    surface = square(2.0, 2.0, 0.0, 1.0)
    T_truth_world = se3.make(np.eye(3), [0, 0, 1.0])
    tree = octree_of(surface - [0, 0, 1.0])
    assert people.ghost_cells(tree, T_truth_world, block) == 0
    assert people.ghost_cells(tree, np.eye(4), block) > 300


def test_an_obstacle_of_the_grid_is_a_ghost_where_truly_nothing_stands_nor_beside(
    people: ModuleType, block: Scene
) -> None:
    truth = block.grid(CELL_M, 0.1, 1.4)
    cells = truth.cells.copy()
    for place in ([2.5, 1.2], [2.5, 1.92]):  # before the cube, which begins at 2 m, and beside it
        cells[tuple(truth.cells_at(place))] = OCCUPIED
    assert people.ghosts_in_the_way(replace(truth, cells=cells), np.eye(4), truth) == 1
    assert people.ghosts_in_the_way(truth, np.eye(4), truth) == 0


def test_ghosts_of_the_grid_are_counted_in_the_true_world(people: ModuleType, block: Scene) -> None:
    truth = block.grid(CELL_M, 0.1, 1.4)
    x, y = truth.origin
    turned = se3.make(se3.exp_so3([0, 0, np.pi / 2]), [5.0, 0, 0])  # onto itself
    assert people.ghosts_in_the_way(truth, turned, truth) == 0
    shifted = replace(truth, origin=(x + 1.0, y))
    assert people.ghosts_in_the_way(shifted, se3.make(np.eye(3), [-1.0, 0, 0]), truth) == 0
    assert people.ghosts_in_the_way(shifted, np.eye(4), truth) > 300


def test_the_area_of_triangles_off_the_surfaces_is_summed(people: ModuleType, block: Scene) -> None:
    corners = np.array([[0.0, 0, 0], [0.3, 0, 0], [0, 0, 0.4]])
    on, off = corners + [2.2, 1.96, 0.2], corners + [2.2, 1.94, 0.2]  # 4 and 6 cm before the cube
    vertices = np.concatenate([on, off]).astype(np.float32)
    colors, triangles = np.zeros((6, 3), np.uint8), np.arange(6, dtype=np.int32).reshape(2, 3)
    mesh = Mesh(vertices, np.tile(np.float32([0, -1, 0]), (6, 1)), colors, triangles)
    assert people.ghost_area_m2(mesh, np.eye(4), block) == pytest.approx(0.06, rel=1e-5)


def test_walks_with_people_are_held_against_the_one_without(
    people: ModuleType, missed: Callable[..., Any]
) -> None:
    measured = people.Measurement
    empty = [measured("a", "vnav", "ATE RMSE", 0.01, "m"), measured("a", "vnav", "ghost cells", 50)]
    found = [measured("a", "vnav", "ATE RMSE", 0.02, "m"), measured("a", "vnav", "ghost cells", 55)]
    held = people.held_against(empty, found)
    assert [m.wanted for m in held] == ["at most 0.015", "at most 60"]
    assert missed(held) == held[:1]


def test_the_same_walk_is_asked_for_with_and_without_people(
    people: ModuleType, tmp_path: Path
) -> None:
    few, none = (people.spec_of("one_room", share, 3, 320) for share in (0.1, 0.0))
    assert (few.walkers, none.walkers) == (2, 0)
    assert people.replace(few, walkers=0, walker_share=0.0) == none
    (tmp_path / "there").mkdir()
    assert people.rendered(tmp_path / "there", few) == tmp_path / "there"
    assert not list((tmp_path / "there").iterdir())
