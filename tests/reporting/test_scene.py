"""What the 3D view is given: the map's own points and poses, within the steps of its numbers."""

import base64
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import DTypeLike, NDArray
from scipy.spatial import cKDTree

from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.point_cloud import Mesh, PointCloud
from vnav.io.store.artifacts import (
    load_cloud,
    load_mesh,
    load_odometry,
    load_optimised,
)
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.records import PATH_M
from vnav.reporting import view3d
from vnav.reporting.layers import STEPS, cloud_layer, mesh_layer
from vnav.reporting.scene import MOST_POINTS, MOST_VERTICES, frusta, scene

CAMERA = Intrinsics(320, 240, 300.0, 300.0, 159.5, 119.5)


def array(text: str, dtype: DTypeLike, *shape: int) -> NDArray[Any]:
    return np.frombuffer(base64.b64decode(text, validate=True), dtype).reshape(-1, *shape)


def points_of(layer: dict[str, Any]) -> NDArray[np.float64]:
    steps = array(layer["positions"], "<u2", 3)
    return np.array(layer["low"]) + steps / STEPS * np.array(layer["span"])


@pytest.fixture
def copied(fused_map: Path, tmp_path: Path) -> MapFolder:
    return MapFolder(shutil.copytree(fused_map, tmp_path / "map"))


@pytest.fixture(scope="module")
def values(fused_map: Path) -> dict[str, Any]:
    return values_of(MapFolder(fused_map))


def values_of(folder: MapFolder) -> dict[str, Any]:
    """What a page holds for its script."""
    text = view3d.figure(folder)
    data = re.search(r'<script type="application/json" id="view-data">(.*?)</script>', text)
    assert data is not None
    return dict(json.loads(data[1]))


def test_points_are_those_of_the_cloud_within_half_a_step(
    fused_map: Path, values: dict[str, Any]
) -> None:
    cloud, layer = load_cloud(MapFolder(fused_map)), values["layers"]["cloud"]
    kept = np.linspace(0, len(cloud) - 1, min(len(cloud), MOST_POINTS)).astype(int)
    found, colors = points_of(layer), array(layer["colors"], "u1", 3)
    distance_m, row = cKDTree(cloud.points_world[kept]).query(found)
    half_a_step_m = np.linalg.norm(layer["span"]) / STEPS / 2
    assert distance_m.max() < half_a_step_m + 1e-6
    assert (np.sort(row) == np.arange(len(kept))).all()
    assert (colors == cloud.colors[kept][row]).all()


def test_a_large_cloud_is_thinned_evenly() -> None:
    numbers = np.arange(int(2.5 * MOST_POINTS), dtype="<u4")
    colors = numbers.view(np.uint8).reshape(-1, 4)[:, :3]  # which point it is
    layer = cloud_layer(PointCloud(np.zeros((len(colors), 3)), colors), 0.01, MOST_POINTS)
    assert layer is not None
    found = layer.values["colors"].astype(int) @ [1, 256, 65536]
    assert len(found) == MOST_POINTS
    assert (found.min(), found.max()) == (0, len(colors) - 1)
    assert set(np.diff(np.sort(found))) == {2, 3}


def test_the_first_points_of_a_cloud_are_spread_as_evenly_as_all() -> None:
    colors = np.arange(1000, dtype="<u4").view(np.uint8).reshape(-1, 4)[:, :3]
    layer = cloud_layer(PointCloud(np.zeros((1000, 3)), colors), 0.01)
    assert layer is not None
    found = layer.values["colors"].astype(int) @ [1, 256, 65536]
    assert sorted(found) == [*range(1000)]
    for first in (16, 100, 500):  # at most twice as far apart as they would be at best
        assert np.diff(np.sort(np.r_[found[:first], 1000])).max() <= 2 * 1000 / first


def test_no_cloud_and_no_surface_are_no_layers() -> None:
    nothing = np.zeros((0, 3))
    assert cloud_layer(PointCloud(nothing, nothing), 0.01) is None
    assert mesh_layer(Mesh(nothing, nothing, nothing, nothing)) is None


def test_the_surface_is_near_that_of_the_map_and_not_shown_at_first(
    fused_map: Path, values: dict[str, Any]
) -> None:
    """A mean over a cell lies off a curved surface by less than the cell, of at most 5 cm here."""
    mesh, layer = load_mesh(MapFolder(fused_map)), values["layers"]["mesh"]
    found, rows = points_of(layer), array(layer["triangles"], "<u2", 3)
    assert 1000 < len(found) <= MOST_VERTICES
    assert rows.max() == len(found) - 1
    assert cKDTree(mesh.vertices_world).query(found)[0].max() < 0.05
    assert cKDTree(found).query(mesh.vertices_world)[0].max() < 0.1
    text = view3d.figure(MapFolder(fused_map))
    assert '<input type="checkbox" data-layer="cloud" checked>' in text
    assert '<input type="checkbox" data-layer="mesh">' in text


def test_the_trajectory_is_that_of_the_map(fused_map: Path, values: dict[str, Any]) -> None:
    (line,) = values["layers"]["trajectory"]["lines"]
    poses = load_optimised(MapFolder(fused_map)).T_world_camera
    assert np.isnan(poses[7]).all()
    np.testing.assert_array_equal(array(line, "<f4", 3), poses[:, :3, 3].astype("<f4"))


def test_the_trajectory_has_a_line_on_either_side_of_an_interruption(
    fused_map: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    odometry = load_odometry(MapFolder(fused_map))
    stamps_s = odometry.frames.stamp_s + (np.arange(len(odometry.frames)) > 20)
    later = replace(odometry, frames=replace(odometry.frames, stamp_s=stamps_s))
    monkeypatch.setattr("vnav.reporting.scene.load_odometry", lambda _: later)
    lines = values_of(MapFolder(fused_map))["layers"]["trajectory"]["lines"]
    assert [len(array(line, "<f4", 3)) for line in lines] == [21, len(stamps_s) - 21]


def test_keyframes_and_accepted_loops_stand_where_their_poses_are(
    fused_map: Path, values: dict[str, Any]
) -> None:
    centres = load_optimised(MapFolder(fused_map)).T_world_camera[::5, :3, 3]
    keyframes = array(values["layers"]["keyframes"]["points"], "<f4", 5, 3)
    np.testing.assert_allclose(keyframes[:, 0], centres, atol=1e-6)
    loops = array(values["layers"]["loops"]["pairs"], "<f4", 2, 3)
    np.testing.assert_allclose(loops, centres[None, [0, 11]], atol=1e-6)


def test_a_camera_is_drawn_the_way_it_looks() -> None:
    turned = se3.make(se3.exp_so3([0, np.pi / 2, 0]), [1.0, 2.0, 3.0])
    centre, *corners = frusta(turned[None], CAMERA, 0.3)[0]
    np.testing.assert_allclose(centre, [1, 2, 3])
    middle = np.mean(corners, axis=0)
    np.testing.assert_allclose(middle, [1.3, 2, 3], atol=1e-9)  # its z is the world's x
    sides = [np.linalg.norm(np.subtract(corners[k], corners[k - 1])) for k in (1, 2)]
    np.testing.assert_allclose(sides, [0.32, 0.24])  # 320 and 240 pixels of 1/300, 0.3 m away


def test_located_photos_and_the_last_path_are_shown(copied: MapFolder) -> None:
    assert not {"photo", "photos", "path"} & set(scene(copied).layers)
    pose = {"T_world_camera": np.eye(4).tolist(), "intrinsics": vars(CAMERA)}
    copied.write_current({"photo": "photos/a.jpg", **pose})
    copied.write_photos([{"photo": "b.jpg", **pose}, {"photo": "c.jpg", **pose}])
    copied.write_planned({"path_m": [[0, 1, 3.1], [1, 1, 0.5]], "length_m": 1.0})
    layers = scene(copied).layers
    assert (layers["photo"].label, layers["path"].label) == ("photo a.jpg", "path, 1.0 m")
    assert layers["photo"].values["points"].shape == (1, 5, 3)
    assert layers["photos"].label == "located photos (2)"
    assert layers["photos"].values["points"].shape == (2, 5, 3)
    (path,) = layers["path"].values["lines"]
    assert path.tolist() == np.float32([[0, 1, PATH_M], [1, 1, PATH_M]]).tolist()


def test_a_photo_whose_name_is_markup_is_text(copied: MapFolder) -> None:
    pose = {"T_world_camera": np.eye(4).tolist(), "intrinsics": vars(CAMERA)}
    copied.write_current({"photo": "<script>alert(1)", **pose})
    text = view3d.figure(copied)
    assert "<script>alert" not in text
    assert "photo &lt;script&gt;alert(1)</label>" in text


@pytest.mark.parametrize("camera", [{}, {**vars(CAMERA), "fx": 0.0}])
def test_a_crafted_state_is_not_drawn(copied: MapFolder, camera: dict[str, Any]) -> None:
    pose = {"T_world_camera": np.eye(4).tolist(), "intrinsics": camera}
    copied.write_current({"photo": "a.jpg", **pose})
    copied.write_photos([{"photo": "a.jpg", **pose}])
    copied.write_planned({"path_m": [["x"]], "length_m": 1.0})
    assert copied.photos()
    assert not {"photo", "photos", "path"} & set(scene(copied).layers)


def test_the_same_map_has_the_same_view(fused_map: Path) -> None:
    assert view3d.figure(MapFolder(fused_map)) == view3d.figure(MapFolder(fused_map))


def test_without_scripts_a_sentence_stands_in_place_of_the_view(fused_map: Path) -> None:
    text = view3d.figure(MapFolder(fused_map))
    assert f'<p class="instead">{view3d.INSTEAD}</p>' in text
    assert "#view.runs .instead { display: none }" in view3d.style()  # only view.js adds the class
    assert "runs" not in text[: text.index("<script")]
