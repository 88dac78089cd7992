import json
import struct
import sys
import zipfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vnav
from tests.phones import members, packed, write_r3d
from vnav.api.arguments import capture_of
from vnav.config import CaptureConfig, Config
from vnav.core.camera import Camera
from vnav.errors import CameraError, CaptureError, ConfigError
from vnav.io.formats.camera_file import camera_text
from vnav.io.formats.trajectories import read_tum
from vnav.io.recordings.importing import import_recording
from vnav.io.sources.memory import frames
from vnav.io.sources.open_capture import open_capture
from vnav.io.sources.record3d import Record3dCapture, open_recording
from vnav.io.sources.specks import without_specks
from vnav.stages.odometry import track
from vnav.synthetic import MINIATURE, one_room

FRAMES = 8
CONFIG = CaptureConfig()
COLOR = MINIATURE.camera
SMALL = COLOR.scaled(80, 60)


@dataclass(frozen=True)
class PhoneScan:
    """What the phone saw: colour (N, H, W, 3), depth (N, h, w) in metres."""

    stamps_s: np.ndarray
    color: np.ndarray
    depth_m: np.ndarray

    @property
    def metadata(self) -> dict[str, Any]:
        """As the app writes it; ARKit's matrix, from the image's corner, column by column."""
        K = [COLOR.fx, 0, 0, 0, COLOR.fy, 0, COLOR.cx + 0.5, COLOR.cy + 0.5, 1]
        height, width = self.depth_m.shape[1:]
        pose = [0.0, 0, 0, 1, 0, 0, 0]
        sizes = {"w": COLOR.width, "h": COLOR.height, "dw": width, "dh": height}
        poses = {"initPose": pose, "poses": FRAMES * [pose]}
        times = {"fps": 60, "frameTimestamps": self.stamps_s.tolist()}
        return {"K": K, "perFrameIntrinsicCoeffs": [], **sizes, **poses, **times}

    def members(self) -> dict[str, bytes]:
        return members(self.color, self.depth_m, self.metadata)


@pytest.fixture(scope="module")
def scan(tiny_capture: Path) -> PhoneScan:
    """The first frames of the tiny capture."""
    capture = open_capture(tiny_capture, CONFIG)
    seen = [capture.read(k) for k in range(FRAMES)]
    color, depth_m = ([getattr(each, name) for each in seen] for name in ("color", "depth_m"))
    return PhoneScan(capture.stamps_s[:FRAMES], np.array(color), np.array(depth_m))


@pytest.fixture
def content(scan: PhoneScan) -> dict[str, bytes]:
    return scan.members()


def opened(
    folder: Path, content: dict[str, bytes], config: CaptureConfig = CONFIG
) -> Record3dCapture:
    return open_recording(write_r3d(folder / "scan.r3d", content), config)


def told(content: dict[str, bytes], **values: object) -> dict[str, bytes]:
    """With other values in the metadata."""
    return content | {"metadata": json.dumps(json.loads(content["metadata"]) | values).encode()}


def without(content: dict[str, bytes], *keys: str) -> dict[str, bytes]:
    """Without these values in the metadata."""
    values = json.loads(content["metadata"])
    return content | {"metadata": json.dumps({k: values[k] for k in values.keys() - keys}).encode()}


def test_camera_times_and_frames_come_back(
    content: dict[str, bytes], scan: PhoneScan, tmp_path: Path
) -> None:
    capture = opened(tmp_path, content)
    assert (capture.name, capture.camera) == ("scan", Camera(COLOR, 1.0))
    np.testing.assert_array_equal(capture.stamps_s, scan.stamps_s)
    for k in range(FRAMES):
        np.testing.assert_array_equal(capture.read(k).color, scan.color[k])
        np.testing.assert_array_equal(capture.read(k).depth_m, scan.depth_m[k])


def test_odometry_is_that_of_the_same_frames_from_elsewhere(
    content: dict[str, bytes], scan: PhoneScan, tmp_path: Path
) -> None:
    arrays = frames(scan.color, scan.depth_m, Camera(COLOR, 1.0), scan.stamps_s)
    found = []
    for name, capture in (("scan", opened(tmp_path, content)), ("arrays", arrays)):
        (tmp_path / name / "draft" / "keyframes").mkdir(parents=True)
        found.append(track(capture, Config(), tmp_path / name / "draft").T_segment_camera)
    np.testing.assert_array_equal(*found)
    assert np.isfinite(found[0]).all()


def test_the_commands_take_the_file_for_a_capture(
    content: dict[str, bytes], scan: PhoneScan, tmp_path: Path
) -> None:
    path = write_r3d(tmp_path / "scan.R3D", content)
    assert vnav.check(path).frames == FRAMES
    np.testing.assert_array_equal(capture_of(path, Config(), None).stamps_s, scan.stamps_s)
    with pytest.raises(CaptureError, match="'vnav build-map .*scan.R3D'"):
        import_recording(path, tmp_path / "out")


def test_depth_of_a_lower_resolution_lies_on_the_pixels_of_colour(
    tiny_capture: Path, scan: PhoneScan, tmp_path: Path
) -> None:
    truth = read_tum(tiny_capture / "groundtruth.txt").T_world_camera[:FRAMES]
    room = one_room(MINIATURE.seed)
    coarse = replace(scan, depth_m=np.array([room.render_depth(SMALL, T) for T in truth]))
    capture = opened(tmp_path, coarse.members())
    assert capture.camera.depth == SMALL
    found, true_m = capture.read(2).depth_m, room.render_depth(COLOR, truth[2])
    seen = found > 0
    # Only the rim, half a depth pixel wide, and jumps of depth lie between no measurements.
    assert seen.mean() > 0.9
    # Inverse depth is interpolated, which is exact on planes.
    assert np.percentile(abs(found - true_m)[seen], 90) < 0.001
    assert opened(tmp_path, without(coarse.members(), "dw", "dh")).camera == capture.camera


def test_pixels_of_low_confidence_and_no_numbers_are_no_depth(
    content: dict[str, bytes], scan: PhoneScan, tmp_path: Path
) -> None:
    depth_m, sure = scan.depth_m[3].copy(), np.ones(scan.depth_m[3].shape, np.uint8)
    sure[:100], depth_m[100:110], depth_m[110:120] = 0, np.nan, -1
    changed = {"rgbd/3.depth": packed(depth_m), "rgbd/3.conf": packed(sure)}
    found = opened(tmp_path, content | changed).read(3).depth_m
    assert not found[:120].any()
    np.testing.assert_array_equal(found[120:], scan.depth_m[3, 120:])


def test_depth_without_confidence_is_believed(
    content: dict[str, bytes], scan: PhoneScan, tmp_path: Path
) -> None:
    bare = {name: data for name, data in content.items() if not name.endswith(".conf")}
    np.testing.assert_array_equal(opened(tmp_path, bare).read(3).depth_m, scan.depth_m[3])


def test_confidence_is_part_of_the_fingerprint(content: dict[str, bytes], tmp_path: Path) -> None:
    before = opened(tmp_path, content).fingerprint()
    changed = {"rgbd/3.conf": packed(np.zeros(COLOR.size[::-1], np.uint8))}
    assert opened(tmp_path, content | changed).fingerprint() != before


def test_each_frame_has_its_own_camera_where_the_app_wrote_it(
    content: dict[str, bytes], tmp_path: Path
) -> None:
    cameras = [replace(COLOR, fx=COLOR.fx + k, fy=COLOR.fy + k) for k in range(FRAMES)]
    each = [[k.fx, k.fy, k.cx + 0.5, k.cy + 0.5] for k in cameras]
    capture = opened(tmp_path, told(content, perFrameIntrinsicCoeffs=each))
    assert [capture.read(k).intrinsics for k in range(FRAMES)] == cameras


def test_a_camera_that_is_named_comes_before_what_the_app_wrote(
    content: dict[str, bytes], tmp_path: Path
) -> None:
    camera = Camera(replace(COLOR, fx=300.0), 2.0)
    (tmp_path / "camera.toml").write_text(camera_text(camera))
    path = write_r3d(tmp_path / "scan.r3d", content)
    assert open_recording(path, CONFIG, tmp_path / "camera.toml").camera == camera


def test_units_can_be_set(content: dict[str, bytes], scan: PhoneScan, tmp_path: Path) -> None:
    capture = opened(tmp_path, content, CaptureConfig(units_per_metre=2.0))
    half = without_specks(scan.depth_m[0] / np.float32(2))
    np.testing.assert_allclose(capture.read(0).depth_m, half, rtol=1e-6)


def test_without_times_the_rate_tells_them(content: dict[str, bytes], tmp_path: Path) -> None:
    capture = opened(tmp_path, without(content, "frameTimestamps"))
    np.testing.assert_allclose(capture.stamps_s, np.arange(FRAMES) / 60)


def test_times_may_be_seconds_since_1970(content: dict[str, bytes], tmp_path: Path) -> None:
    stamps_s = [1.79e9 + k / 60 for k in range(FRAMES)]
    capture = opened(tmp_path, told(content, frameTimestamps=stamps_s))
    np.testing.assert_array_equal(capture.stamps_s, stamps_s)


def test_frames_are_in_order_of_time_and_each_time_comes_once(
    content: dict[str, bytes], scan: PhoneScan, tmp_path: Path
) -> None:
    stamps_s = [3.0, 1.0, 2.0, 2.0, 4.0, 5.0, 6.0, 7.0]
    capture = opened(tmp_path, told(content, frameTimestamps=stamps_s))
    np.testing.assert_array_equal(capture.stamps_s, [1, 2, 3, 4, 5, 6, 7])
    for index, number in enumerate((1, 2, 0)):
        np.testing.assert_array_equal(capture.read(index).color, scan.color[number])


SPOILT = {
    "colour that is cut off": ("rgbd/3.jpg", lambda data: data[:-30]),
    "depth that is cut off": ("rgbd/3.depth", lambda data: data[:-30]),
    "depth that is nothing": ("rgbd/3.depth", lambda data: b""),
    "depth that is no LZFSE": ("rgbd/3.depth", lambda data: b"no LZFSE at all"),
    "depth of fewer pixels": ("rgbd/3.depth", lambda data: packed(np.ones(7, np.float32))),
    "depth of far more pixels": ("rgbd/3.depth", lambda data: packed(np.ones(10**6, np.float32))),
    "depth that claims 4 GB": ("rgbd/3.depth", lambda data: b"bvx-" + struct.pack("<I", 2**32 - 9)),
    "confidence that is cut off": ("rgbd/3.conf", lambda data: data[:-5]),
    "colour of another size": ("rgbd/3.jpg", lambda data: small_png()),
}


def small_png() -> bytes:
    return members([np.zeros((4, 4, 3), np.uint8)], [np.ones((4, 4))], {})["rgbd/0.jpg"]


@pytest.mark.parametrize("what", SPOILT)
def test_a_member_that_is_damaged_is_named_and_the_other_frames_are_read(
    what: str, content: dict[str, bytes], scan: PhoneScan, tmp_path: Path
) -> None:
    name, spoil = SPOILT[what]
    capture = opened(tmp_path, content | {name: spoil(content[name])})
    with pytest.raises(CaptureError, match=f"scan.r3d/{name}"):
        capture.read(3)
    assert len(capture) == FRAMES
    for k in (2, 4):
        np.testing.assert_array_equal(capture.read(k).depth_m, scan.depth_m[k])


def test_a_byte_that_changed_on_the_disk_costs_its_frame(
    content: dict[str, bytes], tmp_path: Path
) -> None:
    path = write_r3d(tmp_path / "scan.r3d", content)
    with zipfile.ZipFile(path) as archive:
        at = archive.getinfo("rgbd/3.depth").header_offset + 500
    data = bytearray(path.read_bytes())
    data[at] ^= 1
    path.write_bytes(data)
    capture = open_recording(path, CONFIG)
    with pytest.raises(CaptureError, match="scan.r3d/rgbd/3.depth to be whole"):
        capture.read(3)
    assert capture.read(4).depth_m.any()


def test_a_frame_without_depth_is_named(content: dict[str, bytes], tmp_path: Path) -> None:
    del content["rgbd/3.depth"]
    capture = opened(tmp_path, content)
    with pytest.raises(CaptureError, match="scan.r3d/rgbd/3.depth"):
        capture.read(3)
    assert capture.read(4).depth_m.any()


def test_a_member_that_unpacks_to_gigabytes_is_not_unpacked(
    content: dict[str, bytes], tmp_path: Path
) -> None:
    path = write_r3d(tmp_path / "scan.r3d", content | {"rgbd/3.jpg": b""})
    del content["rgbd/3.jpg"]
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in content.items():
            archive.writestr(name, data)
        archive.writestr("rgbd/3.jpg", bytes(2**27))
    with pytest.raises(CaptureError, match="at most .* bytes in .*rgbd/3.jpg"):
        open_recording(path, CONFIG).read(3)


@pytest.mark.parametrize("kept", [0, 100, -1000])
def test_a_file_that_is_cut_off_is_no_recording(
    kept: int, content: dict[str, bytes], tmp_path: Path
) -> None:
    path = write_r3d(tmp_path / "scan.r3d", content)
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(CaptureError, match="expected a recording of Record3D in .*scan.r3d"):
        open_recording(path, CONFIG)


@pytest.mark.parametrize(
    ("values", "error", "said"),
    [
        ({"K": [1, 2, 3]}, CameraError, "w, h and K .*scan.r3d/metadata"),
        ({"w": "wide"}, CameraError, "w, h and K"),
        ({"w": 0}, CameraError, "possible camera"),
        ({"perFrameIntrinsicCoeffs": FRAMES * [[1, 2]]}, CameraError, "w, h and K"),
        (
            {"perFrameIntrinsicCoeffs": FRAMES * [[9, 9, 9, float("nan")]]},
            CameraError,
            "no numbers",
        ),
        ({"frameTimestamps": FRAMES * ["now"]}, CaptureError, "frameTimestamps"),
        ({"frameTimestamps": FRAMES * [float("nan")]}, CaptureError, "frameTimestamps"),
        ({"frameTimestamps": FRAMES * [10**400]}, CaptureError, "frameTimestamps"),
        ({"dw": -1, "w": 60_000, "h": 59_999}, CaptureError, "dw and dh"),
    ],
)
def test_metadata_that_cannot_be_is_named(
    values: dict[str, object],
    error: type[Exception],
    said: str,
    content: dict[str, bytes],
    tmp_path: Path,
) -> None:
    with pytest.raises(error, match=said):
        opened(tmp_path, told(content, **values))


def test_a_list_of_cameras_that_ends_early_gives_way_to_the_one_of_all(
    content: dict[str, bytes], tmp_path: Path
) -> None:
    stamps_s = [9.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]  # the first frame comes last
    three = 3 * [[1.0, 1.0, 1.0, 1.0]]
    changed = told(content, frameTimestamps=stamps_s, perFrameIntrinsicCoeffs=three)
    assert opened(tmp_path, changed).camera.color == COLOR


def test_units_that_no_camera_has_are_refused(content: dict[str, bytes], tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="capture.units_per_metre"):
        opened(tmp_path, content, CaptureConfig(units_per_metre=1e-300))


def test_confidence_that_is_lost_changes_the_fingerprint(
    content: dict[str, bytes], tmp_path: Path
) -> None:
    found = {opened(tmp_path, content | {"rgbd/3.conf": b""}).fingerprint()}
    del content["rgbd/3.conf"]
    assert len(found | {opened(tmp_path, content).fingerprint()}) == 2


@pytest.mark.parametrize("text", [b"", b"[1]", b"{", b"[" * 100_000, b"\xff\xfe\x00"])
def test_metadata_that_is_no_table_is_named(
    text: bytes, content: dict[str, bytes], tmp_path: Path
) -> None:
    with pytest.raises(CaptureError, match="scan.r3d/metadata"):
        opened(tmp_path, content | {"metadata": text})


def test_colour_alone_is_told(content: dict[str, bytes], tmp_path: Path) -> None:
    bare = {name: data for name, data in content.items() if not name.endswith(".depth")}
    with pytest.raises(CaptureError, match="found 8 images without depth"):
        opened(tmp_path, bare)


def test_without_imagecodecs_the_extra_is_named(
    content: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_r3d(tmp_path / "scan.r3d", content)
    monkeypatch.setitem(sys.modules, "imagecodecs", None)
    with pytest.raises(CaptureError, match=r"'pip install vnav-rgbd\[record3d\]'"):
        capture_of(path, Config(), None)
