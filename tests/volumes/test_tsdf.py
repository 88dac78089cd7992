"""The mesh lies where depth was, faces the camera, and does not depend on threads."""

import numpy as np
import pytest

from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.point_cloud import Mesh
from vnav.volumes import tsdf
from vnav.volumes.tsdf import TsdfVolume

CAMERA = Intrinsics(64, 48, 60.0, 60.0, 31.5, 23.5)
COLOR = np.full((48, 64, 3), (200, 100, 50), np.uint8)


def mesh_of(*frames: tuple[float, np.ndarray]) -> Mesh:
    """Of a wall at a depth, seen from poses."""
    volume = TsdfVolume(0.05, 3.0)
    for depth_m, T_world_camera in frames:
        volume.integrate(np.full((48, 64), depth_m, np.float32), COLOR, CAMERA, T_world_camera)
    return volume.mesh()


def test_a_wall_is_where_it_was_seen_from_two_places() -> None:
    behind = se3.make(np.eye(3), [0, 0, -0.5])
    mesh = mesh_of((1.5, np.eye(4)), (2.0, behind))
    assert len(mesh.triangles) > 100
    # both depths are whole steps of 0.2 mm: only float32 rounding is left
    np.testing.assert_allclose(mesh.vertices_world[:, 2], 1.5, atol=1e-3)


def test_normals_and_winding_face_the_camera() -> None:
    mesh = mesh_of(*[(1.5, np.eye(4))] * 2)
    assert len(mesh.triangles) > 100
    assert (mesh.normals_world[:, 2] < -0.99).all()
    a, b, c = np.moveaxis(mesh.vertices_world[mesh.triangles], 1, 0)
    assert (np.cross(b - a, c - a)[:, 2] < 0).all()


def test_colours_are_those_of_the_frames() -> None:
    mesh = mesh_of(*[(1.5, np.eye(4))] * 2)
    assert len(mesh.colors) > 100
    assert (mesh.colors == (200, 100, 50)).all()


def test_a_surface_that_one_frame_saw_is_left_out() -> None:
    assert len(mesh_of((1.5, np.eye(4))).vertices_world) == 0


def test_nothing_seen_is_an_empty_mesh() -> None:
    assert len(mesh_of().triangles) == 0
    assert len(mesh_of((0.0, np.eye(4))).triangles) == 0


def test_a_frame_whose_few_pixels_open3d_overlooks_adds_nothing() -> None:
    depth_m = np.zeros((48, 64), np.float32)
    depth_m[1, 1] = 1.5
    volume = TsdfVolume(0.05, 3.0)
    volume.integrate(depth_m, COLOR, CAMERA, np.eye(4))
    assert len(volume.mesh().triangles) == 0


def test_depth_beyond_the_range_is_not_fused() -> None:
    assert len(mesh_of(*[(3.2, np.eye(4))] * 2).triangles) == 0


@pytest.mark.parametrize("seed", [1, 2])
def test_the_order_of_vertices_and_triangles_does_not_matter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mesh = mesh_of(*[(1.5, np.eye(4))] * 2)
    assert len(mesh.triangles) > 100
    parts = (mesh.vertices_world, mesh.normals_world, mesh.colors / 255)
    rows = np.hstack(parts).astype(np.float32)
    order = rng.permutation(len(rows))
    shuffled = np.argsort(order)[mesh.triangles]
    turns = (rng.integers(0, 3, len(shuffled))[:, None] + np.arange(3)) % 3
    shuffled = rng.permutation(np.take_along_axis(shuffled, turns, 1))
    again = tsdf._canonical(rows[order], shuffled)
    np.testing.assert_array_equal(again.vertices_world, mesh.vertices_world)
    np.testing.assert_array_equal(again.triangles, mesh.triangles)


def test_more_blocks_than_there_was_room_for_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    frames = [(1.5, np.eye(4))] * 2
    roomy = mesh_of(*frames)
    assert len(roomy.triangles) > 100
    monkeypatch.setattr(tsdf, "BLOCKS", 4)
    np.testing.assert_array_equal(mesh_of(*frames).triangles, roomy.triangles)


def test_the_self_test_passes() -> None:
    tsdf.self_test()
