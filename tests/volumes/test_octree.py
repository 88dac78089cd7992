"""The octree says what is occupied, free and unknown, and comes back from its files."""

from pathlib import Path

import numpy as np
import octomap
import pytest

from vnav.errors import MapError
from vnav.volumes import octree as module
from vnav.volumes.octree import Octree, Scans

SENSOR = np.array([0.05, 0.05, 0.05])


def wall_of(x: float, side: int = 5) -> np.ndarray:
    """Centres of the voxels of a wall at x."""
    steps = (np.arange(side) - side // 2) * 0.1 + 0.05
    y, z = np.meshgrid(steps, steps)
    return np.stack([np.full(y.size, x), y.ravel(), z.ravel()], 1)


def tree_of(*scans: np.ndarray) -> Octree:
    together = Scans(0.1)
    for points in scans:
        together.insert(points, SENSOR)
    return together.octree()


def state_at(octree: Octree, point: list[float]) -> str:
    """Occupied, free or unknown, from the leaves alone."""
    leaves = octree.leaves()
    inside = (np.abs(leaves.centres_world - point) < leaves.size_m[:, None] / 2).all(1)
    if not inside.any():
        return "unknown"
    assert inside.sum() == 1
    return "occupied" if leaves.occupied[inside][0] else "free"


def test_a_ray_frees_what_it_crosses_and_ends_in_something() -> None:
    octree = tree_of(wall_of(1.05))
    assert state_at(octree, [1.05, 0.05, 0.05]) == "occupied"
    assert state_at(octree, [0.55, 0.05, 0.05]) == "free"
    assert state_at(octree, [1.25, 0.05, 0.05]) == "unknown"


def test_every_point_of_a_scan_is_occupied_whatever_rays_cross_it() -> None:
    grazed = np.stack([np.arange(0.35, 2, 0.1), *np.full((2, 17), 0.05)], 1)  # along one ray
    octree = tree_of(grazed)
    leaves = octree.leaves()
    assert leaves.occupied.sum() == len(grazed)


def scans_at_random(rng: np.random.Generator, cell_m: float) -> list[tuple[np.ndarray, ...]]:
    """Points about a moving sensor: anywhere, on borders of voxels, along axes, far outside."""
    found = []
    for _ in range(12):
        sensor = rng.normal(size=3)
        points = sensor + rng.normal(size=(400, 3)) * rng.choice([0.05, 0.5, 3.0], (400, 1))
        points[:50] = np.rint(points[:50] / cell_m) * cell_m
        points[50:70, :2] = sensor[:2]
        points[70] = sensor
        points[71:73] = [[1e6, 0, 0], [0, -1e6, 0]]
        found.append((points, sensor))
    return [*found, (points, np.array([1e7, 0.0, 0.0])), (points[:0], sensor)]


@pytest.mark.parametrize("cell_m", [0.05, 0.1, 1 / 30, 0.37])
def test_scans_make_the_very_tree_that_octomap_makes_of_them(cell_m: float) -> None:
    together, peer = Scans(cell_m), octomap.OcTree(cell_m)
    for points, sensor in scans_at_random(np.random.default_rng(0), cell_m):
        together.insert(points, sensor)
        peer.insertPointCloud(points, sensor, lazy_eval=True)
    peer.updateInnerOccupancy()
    tree = together.octree()
    assert tree._tree.write() == peer.write()
    assert tree.most_likely._tree.writeBinary() == peer.writeBinary()


def cubes_by_octomap(tree: octomap.OcTree) -> list[tuple[float, ...]]:
    return [
        (leaf.getX(), leaf.getY(), leaf.getZ(), leaf.getSize(), leaf.getOccupancy() > 0.5)
        for leaf in tree.begin_leafs()
    ]


@pytest.mark.parametrize("cell_m", [0.05, 1 / 30])
def test_leaves_are_the_very_cubes_in_the_order_in_which_octomap_walks_them(cell_m: float) -> None:
    together = Scans(cell_m)
    for points, sensor in scans_at_random(np.random.default_rng(1), cell_m)[:4]:
        together.insert(points, sensor)
    for octree in (together.octree(), together.octree().most_likely):
        leaves = octree.leaves()
        table = np.column_stack([leaves.centres_world, leaves.size_m, leaves.occupied])
        np.testing.assert_array_equal(table, cubes_by_octomap(octree._tree))


def test_a_voxel_that_is_hit_and_missed_often_stays_within_octomaps_limits(tmp_path: Path) -> None:
    seen = [wall_of(1.05)] * 9 + [wall_of(2.05)] * 12 + [wall_of(1.05)] * 2
    peer = octomap.OcTree(0.1)
    for points in seen:
        peer.insertPointCloud(points, SENSOR, lazy_eval=True)
    peer.updateInnerOccupancy()
    tree_of(*seen).write(tmp_path / "tree.ot")
    assert (tmp_path / "tree.ot").read_bytes() == peer.write()


def test_what_later_scans_see_through_becomes_free() -> None:
    octree = tree_of(wall_of(1.05), *[wall_of(2.05)] * 5)
    assert state_at(octree, [1.05, 0.05, 0.05]) == "free"


def test_leaves_of_the_most_likely_tree_cover_the_same_states() -> None:
    octree = tree_of(wall_of(1.05, 15), *[wall_of(2.05, 15)] * 2)
    likely = octree.most_likely
    assert len(likely.leaves()) < len(octree.leaves())
    volume = [
        [(leaves.size_m[leaves.occupied == state] ** 3).sum() for state in (True, False)]
        for leaves in (octree.leaves(), likely.leaves())
    ]
    np.testing.assert_allclose(volume[0], volume[1])


def test_an_empty_tree_has_no_leaves() -> None:
    assert len(Scans(0.1).octree().leaves()) == 0
    assert len(Scans(0.1).octree().most_likely.leaves()) == 0


@pytest.mark.parametrize("name", ["tree.ot", "tree.bt"])
def test_a_file_is_read_back(name: str, tmp_path: Path) -> None:
    octree = tree_of(wall_of(1.05))
    octree.write(tmp_path / name)
    again = Octree.read(tmp_path / name)
    assert again.resolution_m == 0.1
    expected, found = octree.most_likely.leaves(), again.most_likely.leaves()
    np.testing.assert_array_equal(expected.centres_world, found.centres_world)
    np.testing.assert_array_equal(expected.occupied, found.occupied)


def test_writing_the_binary_file_leaves_the_tree_as_it_was(tmp_path: Path) -> None:
    octree = tree_of(wall_of(1.05))
    octree.write(tmp_path / "before.ot")
    octree.write(tmp_path / "tree.bt")
    octree.write(tmp_path / "after.ot")
    assert (tmp_path / "before.ot").read_bytes() == (tmp_path / "after.ot").read_bytes()


@pytest.mark.parametrize("name", ["tree.ot", "tree.bt"])
@pytest.mark.parametrize("cut", [1, 20, 10_000])
def test_a_file_that_is_cut_short_is_an_error(name: str, cut: int, tmp_path: Path) -> None:
    tree_of(wall_of(1.05)).write(tmp_path / name)
    content = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(content[: max(0, len(content) - cut)])
    with pytest.raises(MapError, match="expected a whole octree"):
        Octree.read(tmp_path / name)


def test_a_missing_file_is_an_error_that_names_it(tmp_path: Path) -> None:
    with pytest.raises(MapError, match=r"none\.ot.*No such file"):
        Octree.read(tmp_path / "none.ot")


def test_something_else_is_no_octree(tmp_path: Path) -> None:
    (tmp_path / "photo.ot").write_bytes(b"\xff\xd8\xff")
    with pytest.raises(MapError, match="3 bytes that are none"):
        Octree.read(tmp_path / "photo.ot")


def test_a_tree_of_more_levels_than_octomap_has_is_no_octree(tmp_path: Path) -> None:
    header = octomap.OcTree(0.1).write().replace(b"size 0", b"size 18")
    inner, leaf = b"\0\0\0\0\x01", b"\0\0\0\0\0"
    (tmp_path / "deep.ot").write_bytes(header + 17 * inner + leaf)
    with pytest.raises(MapError, match="expected a whole octree"):
        Octree.read(tmp_path / "deep.ot")


def test_the_self_test_passes() -> None:
    module.self_test()
