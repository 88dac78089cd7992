"""Exports as the programs open them that they are for."""

import json
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import cv2
import laspy
import numpy as np
import pytest
import trimesh

from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.mapping import Odometry
from vnav.core.point_cloud import Mesh
from vnav.errors import MapError
from vnav.io.formats.gltf import write_glb
from vnav.io.formats.ply import read_cloud
from vnav.io.store.artifacts import load_cloud, load_keyframe, load_mesh, load_optimised
from vnav.io.store.export import export
from vnav.io.store.map_folder import MapFolder

Altering = Callable[[MapFolder, str], AbstractContextManager[Path]]


@pytest.fixture(scope="module")
def views(tiny_map: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The COLMAP model and the transforms.json of the stages' own map."""
    out = tmp_path_factory.mktemp("views")
    export(MapFolder(tiny_map), out, {"colmap": ["txt"], "transforms": ["json"]})
    return out


@pytest.fixture(scope="module")
def model(views: Path) -> Any:
    return reconstruction(views)


def reconstruction(folder: Path) -> Any:
    """COLMAP's own; loaded here, for it takes the signals of each process that loads it."""
    import pycolmap

    return pycolmap.Reconstruction(folder / "sparse" / "0")


def test_colmap_projects_a_landmark_to_its_keypoint(model: Any) -> None:
    errors_px = []
    for image in model.images.values():
        for point in image.points2D:
            if point.has_point3D():
                found = image.project_point(model.points3D[point.point3D_id].xyz)
                errors_px.append(np.hypot(*(found - point.xy)))
    written = [p.error for p in model.points3D.values() for _ in p.track.elements]
    # each landmark's error is the mean of its observations' to 4 digits: so is that of them all
    assert np.mean(errors_px) == pytest.approx(np.mean(written), abs=1e-4)
    # SIFT finds keypoints to 1 px at worst; a centre half a pixel off would move the median
    assert np.median(errors_px) < 0.5


def test_colmap_has_every_landmark_with_its_track(model: Any, folder: MapFolder) -> None:
    seen = load_optimised(folder).landmarks
    assert model.num_points3D() == len(seen)
    assert model.compute_num_observations() == len(seen.landmark)
    last = model.points3D[len(seen)]
    np.testing.assert_allclose(last.xyz, seen.points_world[-1], atol=1e-6)
    assert [e.image_id - 1 for e in last.track.elements] == seen.keyframe[
        seen.landmark == len(seen) - 1
    ].tolist()


def test_colmap_has_the_keyframes_poses_and_camera(
    model: Any, folder: MapFolder, odometry: Odometry, camera: Intrinsics
) -> None:
    poses = load_optimised(folder).T_world_camera
    for number, keyframe in enumerate(odometry.keyframes):
        image = model.images[number + 1]
        T_world_camera = se3.inverse(np.vstack([image.cam_from_world().matrix(), [0, 0, 0, 1]]))
        np.testing.assert_allclose(T_world_camera, poses[keyframe.row], atol=1e-9)
        assert image.num_points2D() == len(keyframe.features)
    (found,) = model.cameras.values()
    assert (found.width, found.height) == camera.size
    centre = [camera.cx + 0.5, camera.cy + 0.5]  # COLMAP counts from the corner of a pixel
    np.testing.assert_allclose(found.params, [camera.fx, camera.fy, *centre])


def test_colmap_gives_a_point_the_colour_of_its_image(model: Any, views: Path) -> None:
    number, point = next(iter(model.points3D.items()))
    first = point.track.elements[0]
    image = model.images[first.image_id]
    x, y = np.rint(image.points2D[first.point2D_idx].xy - 0.5).astype(int)
    pixels = cv2.imread(str(views / "images" / image.name), cv2.IMREAD_COLOR_RGB)
    assert point.color.tolist() == pixels[y, x].tolist(), number


def test_transforms_lead_from_depth_to_the_landmarks(
    views: Path, folder: MapFolder, odometry: Odometry
) -> None:
    top = json.loads((views / "transforms.json").read_text("utf-8"))
    seen = load_optimised(folder).landmarks
    misses_m = []
    for number, (frame, keyframe) in enumerate(zip(top["frames"], odometry.keyframes, strict=True)):
        assert (views / frame["file_path"]).is_file()
        depth_mm = cv2.imread(str(views / frame["depth_file_path"]), cv2.IMREAD_UNCHANGED)
        rows = seen.keyframe == number
        x, y = keyframe.features.keypoints_px[seen.feature[rows]].T
        z = depth_mm[np.rint(y).astype(int), np.rint(x).astype(int)] * top["integer_depth_scale"]
        rays = [(x + 0.5 - top["cx"]) / top["fl_x"], -(y + 0.5 - top["cy"]) / top["fl_y"]]
        points_camera = np.stack([rays[0] * z, rays[1] * z, -z], 1)
        found = se3.transform(np.array(frame["transform_matrix"]), points_camera)
        away_m = np.linalg.norm(found - seen.points_world[seen.landmark[rows]], axis=1)
        misses_m.append(away_m[z > 0])
    # depth to 1 mm and its noise at 4 m; a wrong axis or unit misses by metres
    assert np.median(np.concatenate(misses_m)) < 0.03
    assert len(read_cloud(views / top["ply_file_path"])) == len(seen)


def test_a_depth_image_is_the_keyframe_s_in_millimetres(
    views: Path, folder: MapFolder, odometry: Odometry
) -> None:
    row = odometry.keyframes[1].row
    depth_mm = cv2.imread(str(views / "depths" / f"{row:06d}.png"), cv2.IMREAD_UNCHANGED)
    truth = load_keyframe(folder, row, odometry.frames).depth_m
    np.testing.assert_allclose(depth_mm / 1000, truth, atol=0.0005 + 1e-6)


def test_a_map_without_landmarks_is_a_model_without_points(posed_map: Path, tmp_path: Path) -> None:
    export(MapFolder(posed_map), tmp_path, {"colmap": ["txt"], "transforms": ["json"]})
    model = reconstruction(tmp_path)
    assert (model.num_images(), model.num_points3D()) == (12, 0)


@pytest.fixture(scope="module")
def glb(fused_map: Path, tmp_path_factory: pytest.TempPathFactory) -> trimesh.Trimesh:
    out = tmp_path_factory.mktemp("glb")
    export(MapFolder(fused_map), out, {"mesh": ["glb"]})
    (surface,) = trimesh.load_scene(out / "mesh.glb", process=False).geometry.values()
    return surface


def test_a_glb_is_the_mesh_with_y_up(glb: trimesh.Trimesh, fused_map: Path) -> None:
    mesh = load_mesh(MapFolder(fused_map))
    x, y, z = mesh.vertices_world.T
    np.testing.assert_allclose(glb.vertices, np.stack([x, z, -y], 1))
    np.testing.assert_array_equal(glb.faces, mesh.triangles)
    x, y, z = mesh.normals_world.T
    np.testing.assert_allclose(glb.vertex_normals, np.stack([x, z, -y], 1), atol=1e-6)


def test_a_glb_s_colours_are_linear(glb: trimesh.Trimesh, fused_map: Path) -> None:
    linear = glb.visual.vertex_attributes["color"][:, :3] / 65535
    dark, bright = 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055
    srgb = np.where(linear <= 0.0031308, dark, bright)
    # a step of 16 bits is 0.05 of 255 where the curve is steepest
    np.testing.assert_allclose(255 * srgb, load_mesh(MapFolder(fused_map)).colors, atol=0.06)


def test_the_glb_of_an_empty_mesh_is_an_empty_scene(tmp_path: Path) -> None:
    none = np.zeros((0, 3))
    write_glb(tmp_path / "mesh.glb", Mesh(none, none, none, none))
    assert not trimesh.load_scene(tmp_path / "mesh.glb").geometry


def test_las_is_the_cloud_to_its_scale(fused_map: Path, tmp_path: Path) -> None:
    export(MapFolder(fused_map), tmp_path, {"cloud": ["las"]})
    found, cloud = laspy.read(tmp_path / "cloud.las"), load_cloud(MapFolder(fused_map))
    assert found.header.scales.max() <= 1e-4
    np.testing.assert_allclose(found.xyz, cloud.points_world, atol=0.5001e-4)
    colors = np.stack([found.red, found.green, found.blue], 1)
    np.testing.assert_array_equal(colors, cloud.colors.astype(int) * 257)


def test_las_without_laspy_names_the_extra_and_writes_nothing(
    fused_map: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "laspy", None)
    with pytest.raises(MapError, match=r"vnav-rgbd\[export\]"):
        export(MapFolder(fused_map), tmp_path / "out", {"mesh": ["ply"], "cloud": ["las"]})
    assert not (tmp_path / "out").exists()
