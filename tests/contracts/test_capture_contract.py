"""What every source of frames must hold: a new one adds a line to SOURCES, a new format of image
files a line to WRITERS."""

import json
import os
import shutil
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.films import film
from tests.phones import members, write_r3d
from vnav.config import CaptureConfig
from vnav.core import se3
from vnav.core.frame import Frame
from vnav.errors import CaptureError
from vnav.io.formats.camera_file import read_camera
from vnav.io.sources.capture import Capture, FileBacked
from vnav.io.sources.folder_capture import FolderCapture
from vnav.io.sources.memory import frames
from vnav.io.sources.open_capture import FORMATS, open_capture
from vnav.io.sources.record3d import open_recording
from vnav.io.sources.rectify import rectified
from vnav.io.sources.subset import Subset

FRAMES = 5
WIDTH, HEIGHT = 32, 24
CAMERA = """
[color]
width = 32
height = 24
fx = 30.0
fy = 30.0
cx = 15.5
cy = 11.5
distortion = [0.1, -0.05, 0.001, 0.001]
[depth]
units_per_metre = 1000
fx = 33.0
fy = 33.0
cx = 15.5
cy = 11.5
T_color_depth = [[1, 0, 0, -0.02], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
"""


@dataclass(frozen=True)
class Recording:
    """What every source in this suite delivers, each in its own way."""

    color: np.ndarray  # (N, H, W, 3) uint8, RGB
    depth: np.ndarray  # (N, H, W) uint16
    camera: str = CAMERA


def recorded() -> Recording:
    rng = np.random.default_rng(0)
    color = rng.integers(0, 256, (FRAMES, HEIGHT, WIDTH, 3), np.uint8)
    depth = rng.integers(2000, 2009, (FRAMES, HEIGHT, WIDTH), np.uint16)
    depth += 10 * np.arange(FRAMES, dtype=np.uint16)[:, None, None]
    depth[:, :4, :4] = 0
    return Recording(color, depth)


def write(root: Path, recording: Recording, k: int, color_name: str, depth_name: str) -> None:
    images = recording.color[k, ..., ::-1], recording.depth[k]
    for name, image in zip((color_name, depth_name), images, strict=True):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(root / name), image)


def write_tum(root: Path, recording: Recording) -> None:
    for k in range(FRAMES):
        write(root, recording, k, f"rgb/{1 + k / 10:.6f}.png", f"depth/{1.004 + k / 10:.6f}.png")
    for kind, first in (("rgb", 1.0), ("depth", 1.004)):
        stamps = [f"{first + k / 10:.6f}" for k in range(FRAMES)]
        (root / f"{kind}.txt").write_text("".join(f"{s} {kind}/{s}.png\n" for s in stamps))


def write_seven_scenes(root: Path, recording: Recording) -> None:
    for k in range(FRAMES):
        write(root, recording, k, f"frame-{k:06d}.color.png", f"frame-{k:06d}.depth.png")


def write_videos(root: Path, recording: Recording) -> None:
    film(root / "color.avi", recording.color)
    film(root / "depth.avi", recording.depth)


def write_stray_scanner(root: Path, recording: Recording) -> None:
    """Colour in a video."""
    film(root / "rgb.mp4", recording.color)
    (root / "depth").mkdir(exist_ok=True)
    for k in range(FRAMES):
        cv2.imwrite(str(root / "depth" / f"{k:06d}.png"), recording.depth[k])
    lines = [
        f"{1 + k / 10}, {k:06d}, 0.0, 0.0, {-k / 10}, 0.0, 0.0, 0.0, 1.0" for k in range(FRAMES)
    ]
    head = "timestamp, frame, x, y, z, qx, qy, qz, qw"
    (root / "odometry.csv").write_text("\n".join([head, *lines]))
    (root / "camera_matrix.csv").write_text("30.0, 0.0, 16.0\n0.0, 30.0, 12.0\n0.0, 0.0, 1.0")


def write_polycam(root: Path, recording: Recording) -> None:
    (root / "keyframes").mkdir(exist_ok=True)
    camera = {"width": WIDTH, "height": HEIGHT, "fx": 30.0, "fy": 30.0, "cx": 16.0, "cy": 12.0}
    pose = {f"t_{r}{c}": float(r == c) for r in range(3) for c in range(4)}
    (root / "keyframes" / "cameras").mkdir(exist_ok=True)
    for k in range(FRAMES):
        name = str(1_000_000 + 100_000 * k)
        write(root, recording, k, f"keyframes/images/{name}.png", f"keyframes/depth/{name}.png")
        text = json.dumps(camera | pose | {"t_23": -k / 10})
        (root / "keyframes" / "cameras" / f"{name}.json").write_text(text)


def write_color_depth(root: Path, recording: Recording) -> None:
    for k in range(FRAMES):
        write(root, recording, k, f"color/{k:05d}.png", f"depth/{k:05d}.png")


WRITERS: dict[str, Callable[[Path, Recording], None]] = {
    "TUM RGB-D": write_tum,
    "7-Scenes": write_seven_scenes,
    "Stray Scanner": write_stray_scanner,
    "Polycam": write_polycam,
    "colour and depth folders": write_color_depth,
    "videos": write_videos,
}


def written(name: str, root: Path, recording: Recording) -> FolderCapture:
    """The recording as a folder of a format."""
    root.mkdir(parents=True, exist_ok=True)
    WRITERS[name](root, recording)
    (root / "camera.toml").write_text(recording.camera)
    return open_capture(root, CaptureConfig())


def in_memory(root: Path, recording: Recording) -> Capture:
    """The recording as arrays."""
    root.mkdir(parents=True, exist_ok=True)
    (root / "camera.toml").write_text(recording.camera)
    camera = read_camera(root / "camera.toml")
    poses = se3.exp(np.arange(len(recording.color))[:, None] * np.full(6, 0.01))
    return frames(recording.color, recording.depth, camera, name="capture", poses=poses)


def chosen(root: Path, recording: Recording) -> Capture:
    """The recording as every second frame of a longer one."""
    twice = (images.repeat(2, 0) for images in (recording.color, recording.depth))
    whole = in_memory(root, Recording(*twice, recording.camera))
    return Subset(whole, range(1, 2 * FRAMES, 2))


def in_record3d(root: Path, recording: Recording) -> Capture:
    """The recording as one file of a phone, in metres."""
    root.mkdir(parents=True, exist_ok=True)
    camera = root / "camera.toml"
    camera.write_text(recording.camera.replace("units_per_metre = 1000", "units_per_metre = 1"))
    depth_m = recording.depth / np.float32(1000)
    path = write_r3d(root / "capture.r3d", members(recording.color, depth_m, {"fps": 10}))
    return open_recording(path, CaptureConfig(), camera)


Source = Callable[[Path, Recording], Capture]
SOURCES: dict[str, Source] = {
    **{name: partial(written, name) for name in WRITERS},
    "arrays": in_memory,
    "subset": chosen,
    "Record3D": in_record3d,
}


@pytest.fixture(params=SOURCES)
def source(request: pytest.FixtureRequest) -> Source:
    return SOURCES[request.param]


@pytest.fixture
def capture(source: Source, tmp_path: Path) -> Capture:
    return source(tmp_path / "capture", recorded())


@pytest.fixture(params=WRITERS)
def folder(request: pytest.FixtureRequest, tmp_path: Path) -> FolderCapture:
    return written(request.param, tmp_path / "capture", recorded())


@pytest.fixture(params=[name for name in WRITERS if name != "videos"])
def with_depth_images(request: pytest.FixtureRequest, tmp_path: Path) -> FolderCapture:
    """A folder with a file for each depth image."""
    return written(request.param, tmp_path / "capture", recorded())


def test_every_format_is_held_to_this() -> None:
    assert [reader.NAME for reader in FORMATS] == list(WRITERS)


def test_frames_are_counted_named_and_in_order_of_time(capture: Capture) -> None:
    assert capture.name == "capture"
    assert len(capture) == FRAMES
    assert capture.stamps_s.shape == (FRAMES,)
    assert capture.stamps_s.dtype == np.float64
    assert (np.diff(capture.stamps_s) > 0).all()


def test_a_frame_is_colour_in_bytes_and_depth_in_metres_that_cannot_be_changed(
    capture: Capture,
) -> None:
    frame = capture.read(3)
    assert (frame.capture, frame.index, frame.stamp_s) == (0, 3, capture.stamps_s[3])
    assert frame.color.shape == (HEIGHT, WIDTH, 3)
    assert frame.color.dtype == np.uint8
    assert frame.depth_m.shape == (HEIGHT, WIDTH)
    assert frame.depth_m.dtype == np.float32
    assert capture.has_depth
    assert np.median(frame.depth_m[frame.depth_m > 0]) == pytest.approx(2.034, abs=0.005)
    assert not frame.color.flags.writeable
    assert not frame.depth_m.flags.writeable


def test_a_frame_has_the_pinhole_camera_of_its_images(capture: Capture) -> None:
    assert capture.read(2).intrinsics == rectified(capture.camera)


def test_colour_is_undistorted_and_depth_registered(capture: Capture) -> None:
    frame, recording = capture.read(0), recorded()
    assert (frame.color != recording.color[0]).mean() > 0.5
    # Where colour sees beyond the depth camera's narrower view there is nothing.
    assert not frame.depth_m[:, -1].any()
    assert (frame.depth_m > 0).mean() < (recording.depth[0] > 0).mean()


def test_the_same_recording_is_the_same_frames_from_every_source(
    source: Source, tmp_path: Path
) -> None:
    expected = in_memory(tmp_path / "expected", recorded())
    capture = source(tmp_path / "capture", recorded())
    for k in range(FRAMES):
        assert_same_images(capture.read(k), expected.read(k))


def test_threads_read_the_same_frames(source: Source, tmp_path: Path, capture: Capture) -> None:
    alone = [capture.read(k) for k in range(FRAMES)]
    again = source(tmp_path / "capture", recorded())
    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(again.read, [k % FRAMES for k in range(4 * FRAMES)]))
    for k, frame in enumerate(together):
        assert_same_images(frame, alone[k % FRAMES])


def assert_same_images(frame: Frame, expected: Frame) -> None:
    np.testing.assert_array_equal(frame.color, expected.color)
    np.testing.assert_array_equal(frame.depth_m, expected.depth_m)


def test_poses_where_the_source_knows_some_are_rigid_and_have_the_frames_times(
    capture: Capture,
) -> None:
    if capture.poses is not None:
        assert se3.is_rigid(capture.poses.T_world_camera)
        assert np.isin(capture.stamps_s, capture.poses.stamps_s).all()


def test_the_fingerprint_is_that_of_the_content_wherever_it_lies(
    source: Source, tmp_path: Path, capture: Capture
) -> None:
    assert source(tmp_path / "elsewhere", recorded()).fingerprint() == capture.fingerprint()


def changed_color() -> Recording:
    color = recorded().color
    color[2, 5, 5] ^= 1
    return replace(recorded(), color=color)


def changed_depth() -> Recording:
    depth = recorded().depth
    depth[4, 9, 9] += 1
    return replace(recorded(), depth=depth)


def changed_camera() -> Recording:
    return replace(recorded(), camera=CAMERA.replace("cx = 15.5", "cx = 15.6"))


@pytest.mark.parametrize("changed", [changed_color, changed_depth, changed_camera])
def test_the_fingerprint_changes_with_an_image_and_with_the_camera(
    source: Source, tmp_path: Path, capture: Capture, changed: Callable[[], Recording]
) -> None:
    assert source(tmp_path / "changed", changed()).fingerprint() != capture.fingerprint()


def test_image_files_can_be_checked_where_there_are_some(folder: FolderCapture) -> None:
    assert isinstance(folder, FileBacked)
    assert not isinstance(in_memory(folder.root, recorded()), FileBacked)


def test_a_damaged_file_is_named_and_the_other_frames_are_read(
    with_depth_images: FolderCapture,
) -> None:
    folder, pairs = with_depth_images, with_depth_images.files.pairs
    spoilt = [(1, "color"), (2, "depth")]
    if pairs[1].color.video_frame is not None:  # one file holds all colour
        spoilt = [(2, "depth")]
    for index, kind in spoilt:
        damaged = getattr(pairs[index], kind).path
        damaged.write_bytes(damaged.read_bytes()[:-30])
    pairs[3].depth.path.unlink()
    for index, kind in (*spoilt, (3, "depth")):
        with pytest.raises(CaptureError) as error:
            folder.read(index)
        assert str(getattr(pairs[index], kind).path) in str(error.value)
    assert folder.read(4).depth_m.any()


def test_an_image_of_another_size_is_named(with_depth_images: FolderCapture) -> None:
    path = with_depth_images.files.pairs[1].depth.path
    cv2.imwrite(str(path), np.ones((8, 8), np.uint16))
    with pytest.raises(CaptureError, match=f"expected 32 x 24 pixels in {path}.*found 8 x 8"):
        with_depth_images.read(1)


def test_files_beside_the_frames_and_their_dates_are_no_part_of_the_fingerprint(
    folder: FolderCapture,
) -> None:
    copy = folder.root.parent / "elsewhere"
    shutil.copytree(folder.root, copy)
    os.utime(copy / "camera.toml", (0, 0))
    (copy / "notes.txt").write_text("not part of the frames")
    assert open_capture(copy, CaptureConfig()).fingerprint() == folder.fingerprint()


def test_a_byte_after_an_image_changes_the_fingerprint(folder: FolderCapture) -> None:
    before = folder.fingerprint()
    path = folder.files.pairs[2].depth.path
    path.write_bytes(path.read_bytes() + b"\0")
    assert folder.fingerprint() != before
