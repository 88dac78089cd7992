import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from vnav.config import CaptureConfig
from vnav.core import se3
from vnav.core.camera import Camera, Intrinsics
from vnav.errors import CameraError, CaptureError, TrajectoryError
from vnav.io.formats.trajectories import read_tum
from vnav.io.sources.folder_capture import FolderCapture
from vnav.io.sources.memory import frames
from vnav.io.sources.open_capture import open_capture, read_poses
from vnav.synthetic import MINIATURE, one_room

FRAMES, STEP_US = 4, 200_000
CONFIG = CaptureConfig()
COLOR = MINIATURE.camera
SMALL = COLOR.scaled(80, 60)
T_UP_ARKIT = se3.make(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), np.zeros(3))
T_CV_GL = np.diag([1.0, -1.0, -1.0, 1.0])


def camera_text(color: Intrinsics, T_up_camera: np.ndarray) -> str:
    T = se3.inverse(T_UP_ARKIT) @ T_up_camera @ T_CV_GL
    values = {f"t_{row}{column}": T[row, column] for row in range(3) for column in range(4)}
    values |= {key: getattr(color, key) for key in ("width", "height", "fx", "fy")}
    values |= {"cx": color.cx + 0.5, "cy": color.cy + 0.5, "blur_score": 120.0}
    return json.dumps(values)


@pytest.fixture(scope="module")
def seen(tiny_capture: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Colour, depth of a quarter of the resolution in mm, and true poses of a few frames."""
    capture, room = open_capture(tiny_capture, CONFIG), one_room(MINIATURE.seed)
    T_world_camera = read_tum(tiny_capture / "groundtruth.txt").T_world_camera[:FRAMES]
    color = np.array([capture.read(k).color for k in range(FRAMES)])
    depth_m = np.array([room.render_depth(SMALL, T) for T in T_world_camera])
    return color, np.rint(depth_m * 1000).astype(np.uint16), T_world_camera


def name(k: int) -> str:
    return str(293_814_600_474 + STEP_US * k)


@pytest.fixture
def folder(seen: tuple[np.ndarray, np.ndarray, np.ndarray], tmp_path: Path) -> Path:
    """A scan as the app exports it, but with PNG, which loses nothing."""
    keyframes = tmp_path / "scan" / "keyframes"
    for kind in ("images", "depth", "confidence", "cameras"):
        (keyframes / kind).mkdir(parents=True)
    for k, (color, depth_mm, T) in enumerate(zip(*seen, strict=True)):
        cv2.imwrite(str(keyframes / "images" / f"{name(k)}.png"), color[..., ::-1])
        cv2.imwrite(str(keyframes / "depth" / f"{name(k)}.png"), depth_mm)
        sure = np.full(depth_mm.shape, 255, np.uint8)
        cv2.imwrite(str(keyframes / "confidence" / f"{name(k)}.png"), sure)
        own = replace(COLOR, fx=COLOR.fx + k, fy=COLOR.fy + k)
        (keyframes / "cameras" / f"{name(k)}.json").write_text(camera_text(own, T))
    return tmp_path / "scan"


def opened(folder: Path) -> FolderCapture:
    return open_capture(folder, CONFIG)


def test_frames_come_back_each_with_its_camera(
    folder: Path, seen: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> None:
    capture = opened(folder)
    colors = [replace(COLOR, fx=COLOR.fx + k, fy=COLOR.fy + k) for k in range(FRAMES)]
    T_color_depth = tuple(map(tuple, np.eye(4).tolist()))
    cameras = [Camera(c, 1000.0, c.scaled(80, 60), T_color_depth) for c in colors]
    expected = frames(*seen[:2], cameras)
    assert capture.camera == cameras[0]
    for k in range(FRAMES):
        found = capture.read(k)
        assert found.intrinsics == colors[k]
        np.testing.assert_array_equal(found.color, expected.read(k).color)
        np.testing.assert_array_equal(found.depth_m, expected.read(k).depth_m)
        assert (found.depth_m > 0).mean() > 0.9


def test_names_are_times_in_microseconds(folder: Path) -> None:
    stamps_s = opened(folder).stamps_s
    assert stamps_s[0] == 293_814.600_474
    np.testing.assert_allclose(np.diff(stamps_s), STEP_US / 1e6, atol=1e-9)


def test_of_two_images_of_one_time_one_is_kept(folder: Path) -> None:
    image = folder / "keyframes" / "images" / f"{name(1)}.png"
    image.with_suffix(".jpg").write_bytes(image.read_bytes())
    assert len(opened(folder)) == FRAMES


def test_poses_are_of_a_camera_that_looks_along_z_in_a_world_whose_z_points_up(
    folder: Path, seen: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> None:
    for poses in (opened(folder).poses, read_poses(folder, CONFIG)):
        np.testing.assert_allclose(poses.T_world_camera, seen[2], atol=1e-9)


def test_optimised_poses_come_before_those_of_the_recording(
    folder: Path, seen: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> None:
    corrected = folder / "keyframes" / "corrected_cameras"
    corrected.mkdir()
    moved = seen[2][1] @ se3.exp([0, 0, 0, 0.05, 0, 0])
    (corrected / f"{name(1)}.json").write_text(camera_text(COLOR, moved))
    capture = opened(folder)
    assert capture.poses.stamps_s.tolist() == [capture.stamps_s[1]]
    np.testing.assert_allclose(capture.poses.T_world_camera[0], moved, atol=1e-9)
    assert capture.camera.color == COLOR


def test_pixels_of_low_confidence_are_no_depth(folder: Path) -> None:
    levels = np.full(SMALL.size[::-1], 54, np.uint8)
    levels[:30] = 0
    cv2.imwrite(str(folder / "keyframes" / "confidence" / f"{name(2)}.png"), levels)
    depth_m = opened(folder).read(2).depth_m
    assert not depth_m[:118].any()
    assert (depth_m[125:] > 0).mean() > 0.8


def test_images_without_depth_or_camera_are_dropped(folder: Path) -> None:
    (folder / "keyframes" / "depth" / f"{name(0)}.png").unlink()
    (folder / "keyframes" / "cameras" / f"{name(2)}.json").unlink()
    capture = opened(folder)
    assert [pair.color.path.stem for pair in capture.files.pairs] == [name(1), name(3)]
    assert len(capture.files.dropped_color) == 2


def test_a_scan_without_depth_is_told(folder: Path) -> None:
    for path in (folder / "keyframes" / "depth").iterdir():
        path.unlink()
    with pytest.raises(CaptureError, match=f"none among {FRAMES} images; export raw data"):
        opened(folder)


@pytest.mark.parametrize(
    ("change", "error", "told"),
    [
        ({"fx": None}, CameraError, "numbers width, height, fx, .* missing or no numbers"),
        ({"fx": 0.0}, CameraError, "possible camera"),
        ({"t_00": 5.0}, TrajectoryError, "rotation and a translation"),
        ({"t_12": "x"}, CameraError, "numbers t_00, t_01"),
    ],
)
def test_what_is_wrong_with_a_camera_is_named(
    folder: Path, change: dict[str, object], error: type[Exception], told: str
) -> None:
    path = folder / "keyframes" / "cameras" / f"{name(1)}.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(error, match=told) as found:
        opened(folder)
    assert str(path) in str(found.value)


@pytest.mark.parametrize("text", ["", "{", "[1]", '{"fx": ' + "9" * 400 + "}"])
def test_a_damaged_camera_is_named(folder: Path, text: str) -> None:
    path = folder / "keyframes" / "cameras" / f"{name(1)}.json"
    path.write_text(text)
    with pytest.raises(CameraError, match=f"{name(1)}.json"):
        opened(folder)
