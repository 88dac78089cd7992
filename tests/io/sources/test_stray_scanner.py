from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.films import film
from vnav.api.arguments import trajectory_of
from vnav.config import CaptureConfig, Config
from vnav.core import se3
from vnav.core.camera import Camera, Intrinsics
from vnav.errors import CameraError, CaptureError, TrajectoryError
from vnav.io.formats.trajectories import read_tum
from vnav.io.sources.folder_capture import FolderCapture
from vnav.io.sources.memory import frames
from vnav.io.sources.open_capture import open_capture, read_poses
from vnav.stages.odometry import track
from vnav.synthetic import MINIATURE, one_room

FRAMES = 8
CONFIG = CaptureConfig()
COLOR = MINIATURE.camera
SMALL = COLOR.scaled(80, 60)
T_UP_ARKIT = se3.make(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), np.zeros(3))


@dataclass(frozen=True)
class Scan:
    """What the phone saw: colour (N, H, W, 3), depth (N, h, w) in mm, poses, z up."""

    stamps_s: np.ndarray
    color: np.ndarray
    depth_mm: np.ndarray
    T_world_camera: np.ndarray


@pytest.fixture(scope="module")
def scan(tiny_capture: Path) -> Scan:
    """The first frames of the tiny capture, its depth in millimetres."""
    capture = open_capture(tiny_capture, CONFIG)
    seen = [capture.read(k) for k in range(FRAMES)]
    truth = read_tum(tiny_capture / "groundtruth.txt")
    return Scan(
        capture.stamps_s[:FRAMES],
        np.array([frame.color for frame in seen]),
        np.array([np.rint(frame.depth_m * 1000) for frame in seen], np.uint16),
        truth.T_world_camera[:FRAMES],
    )


def write(root: Path, scan: Scan, cameras: list[Intrinsics] | None = None) -> Path:
    """A folder as the app exports it, with a codec that loses nothing."""
    for name in ("depth", "confidence"):
        (root / name).mkdir(parents=True)
    film(root / "rgb.mp4", scan.color)
    head = "timestamp, frame, x, y, z, qx, qy, qz, qw" + ", fx, fy, cx, cy" * bool(cameras)
    lines = [head]
    for k, T_up_camera in enumerate(scan.T_world_camera):
        cv2.imwrite(str(root / "depth" / f"{k:06d}.png"), scan.depth_mm[k])
        sure = np.full(scan.depth_mm[k].shape, 2, np.uint8)
        cv2.imwrite(str(root / "confidence" / f"{k:06d}.png"), sure)
        T = se3.inverse(T_UP_ARKIT) @ T_up_camera
        values = [scan.stamps_s[k], f"{k:06d}", *T[:3, 3], *se3.quat_xyzw(T[:3, :3])]
        if cameras:
            own = cameras[k]
            values += [own.fx, own.fy, own.cx + 0.5, own.cy + 0.5]
        lines.append(", ".join(map(str, values)))
    (root / "odometry.csv").write_text("\n".join(lines) + "\n")
    matrix = [[COLOR.fx, 0, COLOR.cx + 0.5], [0, COLOR.fy, COLOR.cy + 0.5], [0, 0, 1]]
    text = "\n".join(", ".join(map(str, row)) for row in matrix)
    (root / "camera_matrix.csv").write_text(text)
    return root


@pytest.fixture
def folder(scan: Scan, tmp_path: Path) -> Path:
    return write(tmp_path / "scan", scan)


def opened(folder: Path) -> FolderCapture:
    return open_capture(folder, CONFIG)


def test_camera_times_and_frames_come_back(folder: Path, scan: Scan) -> None:
    capture = opened(folder)
    assert capture.camera == Camera(COLOR, 1000.0)
    np.testing.assert_array_equal(capture.stamps_s, scan.stamps_s)
    expected = frames(scan.color, scan.depth_mm, Camera(COLOR, 1000.0), scan.stamps_s)
    for k in range(FRAMES):
        np.testing.assert_array_equal(capture.read(k).color, expected.read(k).color)
        np.testing.assert_array_equal(capture.read(k).depth_m, expected.read(k).depth_m)


def test_odometry_is_that_of_the_same_frames_from_elsewhere(
    folder: Path, scan: Scan, tmp_path: Path
) -> None:
    arrays = frames(scan.color, scan.depth_mm, Camera(COLOR, 1000.0), scan.stamps_s)
    found = []
    for name, capture in (("scan", opened(folder)), ("arrays", arrays)):
        (tmp_path / name / "draft" / "keyframes").mkdir(parents=True)
        found.append(track(capture, Config(), tmp_path / name / "draft").T_segment_camera)
    np.testing.assert_array_equal(*found)
    assert np.isfinite(found[0]).all()


def test_poses_are_those_of_the_phone_in_a_world_whose_z_points_up(
    folder: Path, scan: Scan
) -> None:
    for poses in (opened(folder).poses, read_poses(folder, CONFIG), trajectory_of(str(folder))):
        np.testing.assert_allclose(poses.T_world_camera, scan.T_world_camera, atol=1e-12)
        np.testing.assert_array_equal(poses.stamps_s, scan.stamps_s)


def test_a_folder_without_poses_is_told(tiny_capture: Path) -> None:
    with pytest.raises(TrajectoryError, match="found none; name a TUM file"):
        read_poses(tiny_capture, CONFIG)


@pytest.fixture(scope="module")
def coarse(scan: Scan) -> Scan:
    """The same with exact depth of a quarter of the resolution."""
    room = one_room(MINIATURE.seed)
    depth_m = [room.render_depth(SMALL, T) for T in scan.T_world_camera]
    return replace(scan, depth_mm=np.rint(np.array(depth_m) * 1000).astype(np.uint16))


def test_depth_of_a_lower_resolution_lies_on_the_pixels_of_colour(
    coarse: Scan, tmp_path: Path
) -> None:
    capture = opened(write(tmp_path / "scan", coarse))
    assert capture.camera.depth == SMALL
    found = capture.read(2).depth_m
    true_m = one_room(MINIATURE.seed).render_depth(COLOR, coarse.T_world_camera[2])
    seen = found > 0
    # Only the rim, half a depth pixel wide, and jumps of depth lie between no measurements.
    assert seen.mean() > 0.9
    # Depth is rounded to 0.5 mm; inverse depth is interpolated, which is exact on planes.
    off_m = abs(found - true_m)[seen]
    assert np.percentile(off_m, 90) < 0.001


def test_pixels_of_low_confidence_are_no_depth(folder: Path) -> None:
    levels = np.full(COLOR.size[::-1], 1, np.uint8)
    levels[:100] = 0
    cv2.imwrite(str(folder / "confidence" / "000003.png"), levels)
    depth_m = opened(folder).read(3).depth_m
    assert not depth_m[:100].any()
    assert (depth_m[100:] > 0).mean() > 0.5


def test_confidence_is_part_of_the_fingerprint(folder: Path) -> None:
    before = opened(folder).fingerprint()
    cv2.imwrite(str(folder / "confidence" / "000003.png"), np.zeros(COLOR.size[::-1], np.uint8))
    assert opened(folder).fingerprint() != before


def test_confidence_of_another_size_costs_its_frame(folder: Path) -> None:
    cv2.imwrite(str(folder / "confidence" / "000003.png"), np.ones((3, 4), np.uint8))
    with pytest.raises(CaptureError, match="000003.png to have the size of .*found .4, 3."):
        opened(folder).read(3)
    assert opened(folder).read(2).depth_m.any()


def test_each_frame_has_its_own_camera_where_the_app_wrote_it(scan: Scan, tmp_path: Path) -> None:
    cameras = [replace(COLOR, fx=COLOR.fx + k, fy=COLOR.fy + k) for k in range(FRAMES)]
    capture = opened(write(tmp_path / "scan", scan, cameras))
    assert [capture.read(k).intrinsics for k in range(FRAMES)] == cameras
    assert capture.camera.color == cameras[0]
    other = opened(write(tmp_path / "other", scan, [cameras[0], *cameras[:-1]]))
    assert other.fingerprint() != capture.fingerprint()


def test_a_camera_toml_comes_before_what_the_app_wrote(folder: Path) -> None:
    values = vars(replace(COLOR, fx=300.0)) | {"distortion": []}
    text = "".join(f"{key} = {value}\n" for key, value in values.items())
    (folder / "camera.toml").write_text(f"[color]\n{text}[depth]\nunits_per_metre = 2000\n")
    capture = opened(folder)
    assert capture.read(1).intrinsics.fx == 300.0
    assert capture.camera.units_per_metre == 2000.0


def test_units_can_be_set(folder: Path) -> None:
    capture = open_capture(folder, CaptureConfig(units_per_metre=500.0))
    np.testing.assert_allclose(
        capture.read(0).depth_m, 2 * opened(folder).read(0).depth_m, rtol=1e-6
    )


def test_frames_without_depth_and_beyond_the_video_are_dropped(folder: Path) -> None:
    (folder / "depth" / "000002.png").unlink()
    with (folder / "odometry.csv").open("a") as file:
        file.write(f"99.0, {FRAMES:06d}, 0, 0, 0, 0, 0, 0, 1\n")
    capture = opened(folder)
    assert len(capture) == FRAMES - 1
    assert [image.video_frame for image in capture.files.dropped_color] == [2]


def test_a_phone_without_depth_is_told(folder: Path) -> None:
    for path in (folder / "depth").iterdir():
        path.unlink()
    with pytest.raises(CaptureError, match="record with a phone that has a LiDAR"):
        opened(folder)


@pytest.mark.parametrize(
    ("name", "text", "error", "told"),
    [
        ("odometry.csv", "", CaptureError, "odometry.csv"),
        ("odometry.csv", "timestamp, frame\n1, 2\n", CaptureError, "line 2, found 1, 2"),
        (
            "odometry.csv",
            "timestamp, frame, x, y, z, qx, qy, qz, qw\n1, 0, 0, 0, 0, 0, 0, 0, 0\n",
            TrajectoryError,
            "unit quaternions .* frame 0",
        ),
        ("camera_matrix.csv", "1, 2\n3", CameraError, "camera_matrix.csv"),
        ("camera_matrix.csv", "0, 0, 8\n0, 9, 8\n0, 0, 1", CameraError, "possible camera"),
    ],
)
def test_what_is_wrong_is_named(
    folder: Path, name: str, text: str, error: type[Exception], told: str
) -> None:
    (folder / name).write_text(text)
    with pytest.raises(error, match=told):
        opened(folder)
