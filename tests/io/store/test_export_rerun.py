"""The recording for rerun, as rerun's own reader opens it."""

import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from vnav.core.mapping import Odometry
from vnav.errors import MapError
from vnav.io.store.artifacts import (
    load_cloud,
    load_loops,
    load_mesh,
    load_odometry,
    load_optimised,
    load_trajectory,
    map_camera,
)
from vnav.io.store.export import export
from vnav.io.store.map_folder import MapFolder

Entities = dict[str, dict[str, list[Any]]]  # values of each component of each entity

MISSING = "rerun-sdk is not installed: pip install 'vnav-rgbd[rerun]'"


def recorded(path: Path) -> Entities:
    """What rerun's reader finds, a value a time, or one of all times."""
    chunk = pytest.importorskip("rerun.chunk", reason=MISSING)
    entities: Entities = {}
    for part in chunk.RrdReader(path).stream().to_chunks():
        for name, values in part.to_record_batch().to_pydict().items():
            entities.setdefault(part.entity_path, {}).setdefault(name, []).extend(values)
    return entities


@pytest.fixture(scope="module")
def asked(whole_map: Path, tmp_path_factory: pytest.TempPathFactory) -> MapFolder:
    """A map that remembers photos, taken where its first frame was, and a path."""
    root = shutil.copytree(whole_map, tmp_path_factory.mktemp("asked") / "map")
    folder = MapFolder(root)
    pose = load_optimised(folder).T_world_camera[0].tolist()
    camera = {"width": 64, "height": 48, "fx": 50.0, "fy": 51.0, "cx": 31.5, "cy": 23.5}
    note = {"photo": "a.jpg", "T_world_camera": pose, "intrinsics": camera}
    folder.write_current(note)
    folder.write_photos([note, {"photo": "what no version of locate wrote"}])
    folder.write_planned({"path_m": [[0.0, 0.0, 1.0], [1.0, 0.5, 2.0]], "length_m": 1.1})
    return folder


@pytest.fixture(scope="module")
def rrd(asked: MapFolder, tmp_path_factory: pytest.TempPathFactory) -> Entities:
    pytest.importorskip("rerun", reason=MISSING)
    out = tmp_path_factory.mktemp("rrd")
    export(asked, out, {"rerun": ["rrd"]})
    return recorded(out / "map.rrd")


@pytest.fixture(scope="module")
def mapped(asked: MapFolder) -> Odometry:
    return load_odometry(asked)


def rgb(packed: list[int]) -> NDArray[np.int64]:
    """Colours (N, 3) of rerun's whole numbers, red first."""
    return (np.array(packed, np.int64)[:, None] >> np.array([24, 16, 8])) & 255


def poses(camera: dict[str, list[Any]]) -> NDArray[np.float64]:
    """Poses (N, 4, 4) of a camera; rerun's matrices go down columns."""
    T = np.tile(np.eye(4), (len(camera["Transform3D:mat3x3"]), 1, 1))
    columns = np.array(camera["Transform3D:mat3x3"]).reshape(-1, 3, 3)
    T[:, :3, :3] = columns.transpose(0, 2, 1)
    T[:, :3, 3] = np.array(camera["Transform3D:translation"])[:, 0]
    return T


def test_the_world_is_z_up(rrd: Entities) -> None:
    right, forward, up = 3, 5, 1  # rerun's numbers of directions
    assert rrd["/world"]["ViewCoordinates:xyz"] == [[[right, forward, up]]]


def test_cloud_and_landmarks_are_the_map_s(rrd: Entities, asked: MapFolder) -> None:
    cloud, landmarks = load_cloud(asked), load_optimised(asked).landmarks
    found = rrd["/world/cloud"]
    np.testing.assert_array_equal(found["Points3D:positions"][0], cloud.points_world)
    np.testing.assert_array_equal(rgb(found["Points3D:colors"][0]), cloud.colors)
    found = rrd["/world/landmarks"]
    np.testing.assert_array_equal(found["Points3D:positions"][0], landmarks.points_world)
    assert len(found["Points3D:colors"][0]) == len(landmarks) > 100


def test_the_surface_is_the_map_s(rrd: Entities, asked: MapFolder) -> None:
    mesh, found = load_mesh(asked), rrd["/world/mesh"]
    np.testing.assert_array_equal(found["Mesh3D:vertex_positions"][0], mesh.vertices_world)
    np.testing.assert_array_equal(found["Mesh3D:vertex_normals"][0], mesh.normals_world)
    np.testing.assert_array_equal(found["Mesh3D:triangle_indices"][0], mesh.triangles)
    np.testing.assert_array_equal(rgb(found["Mesh3D:vertex_colors"][0]), mesh.colors)


def test_the_camera_moves_by_the_stamps(rrd: Entities, asked: MapFolder) -> None:
    camera, truth = rrd["/world/camera_0"], load_trajectory(asked)
    # 32 bits of metres and of entries up to 1
    np.testing.assert_allclose(poses(camera), truth.T_world_camera, atol=1e-6)
    stamps_s = [stamp.timestamp() for stamp in camera["stamp"][: len(truth)]]
    np.testing.assert_allclose(stamps_s, truth.stamps_s, rtol=0, atol=1e-6)


def test_the_camera_s_path_is_a_line(rrd: Entities, asked: MapFolder) -> None:
    (line,) = rrd["/world/trajectory_0"]["LineStrips3D:strips"][0]
    np.testing.assert_allclose(line, load_trajectory(asked).positions, atol=1e-6)


def test_keyframes_are_pinholes_at_their_poses(
    rrd: Entities, asked: MapFolder, mapped: Odometry
) -> None:
    truth, k = load_optimised(asked).T_world_camera, map_camera(asked)
    K = [k.fx, 0, 0, 0, k.fy, 0, k.cx + 0.5, k.cy + 0.5, 1]  # from the corner of a pixel
    for row in mapped.keyframe_rows:
        keyframe = rrd[f"/world/keyframes/{row:06d}"]
        np.testing.assert_allclose(poses(keyframe)[0], truth[row], atol=1e-6)
        np.testing.assert_allclose(keyframe["Pinhole:image_from_camera"][0][0], K, rtol=1e-6)
        assert keyframe["Pinhole:resolution"] == [[list(k.size)]]


def test_a_keyframe_s_image_is_seen_from_its_stamp_on(
    rrd: Entities, asked: MapFolder, mapped: Odometry
) -> None:
    camera, rows = rrd["/world/camera_0"], mapped.keyframe_rows
    blobs = [bytes(blob[0]) for blob in camera["EncodedImage:blob"]]
    files = [asked.root / "odometry" / "keyframes" / f"{row:06d}.jpg" for row in rows]
    assert blobs == [file.read_bytes() for file in files]
    stamps_s = [stamp.timestamp() for stamp in camera["stamp"][-len(rows) :]]
    np.testing.assert_allclose(stamps_s, mapped.frames.stamp_s[rows], rtol=0, atol=1e-6)


def test_kept_loops_are_lines_between_keyframes(
    rrd: Entities, asked: MapFolder, mapped: Odometry
) -> None:
    kept = [(v.i, v.j) for v in load_loops(asked) if v.accepted and v.is_loop]
    centres = load_optimised(asked).T_world_camera[mapped.keyframe_rows, :3, 3]
    found = np.array(rrd["/world/loops"]["LineStrips3D:strips"][0])
    assert len(kept) > 0
    np.testing.assert_allclose(found, centres[np.array(kept)], atol=1e-6)


def test_photos_and_path_are_where_the_map_remembers_them(rrd: Entities, asked: MapFolder) -> None:
    truth = load_optimised(asked).T_world_camera[0]
    for name in ("/world/photo", "/world/photos/0"):
        np.testing.assert_allclose(poses(rrd[name])[0], truth, atol=1e-6)
        assert rrd[name]["Pinhole:resolution"] == [[[64, 48]]]
    assert "/world/photos/1" not in rrd
    path = rrd["/world/path"]["LineStrips3D:strips"][0]
    np.testing.assert_allclose(path, [[[0, 0, 0.05], [1, 0.5, 0.05]]], atol=1e-6)


def test_frames_without_a_pose_break_the_line(fused_map: Path, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason=MISSING)
    export(MapFolder(fused_map), tmp_path, {"rerun": ["rrd"]})
    lines = recorded(tmp_path / "map.rrd")["/world/trajectory_0"]["LineStrips3D:strips"][0]
    known = np.isfinite(load_optimised(MapFolder(fused_map)).T_world_camera[:, 0, 0])
    assert len(lines) == 2  # one frame is lost
    assert sum(map(len, lines)) == known.sum()


def test_rerun_without_its_package_names_the_extra_and_writes_nothing(
    fused_map: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(MapError, match=r"vnav-rgbd\[rerun\]"):
        export(MapFolder(fused_map), tmp_path / "out", {"mesh": ["ply"], "rerun": ["rrd"]})
    assert not (tmp_path / "out").exists()
