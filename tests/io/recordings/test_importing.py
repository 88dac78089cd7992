"""Bags become captures: the same images, times, camera and poses, or one error and nothing."""

import hashlib
import sys
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.io.recordings.bags import (
    CAMERA,
    COLOR,
    COLOR_INFO,
    DEPTH,
    DEPTH_INFO,
    OLD_TF,
    SIZE,
    TF,
    WRITERS,
    Sent,
    camera_info,
    compressed,
    image,
    recorded,
    shortened,
    transform,
)
from vnav.config import CaptureConfig, Config
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.errors import CameraError, CaptureError, VnavError
from vnav.io.formats.camera_file import read_camera
from vnav.io.formats.images import read_depth, read_image
from vnav.io.formats.trajectories import read_tum
from vnav.io.recordings.importing import ImportedCapture, import_recording
from vnav.io.recordings.ros_topics import TopicNames
from vnav.io.sources.open_capture import open_capture

FRAMES = 6
STEP_NS = 100_000_000
DEPTH_FRAME = "camera_depth_optical_frame"
OWN_DEPTH, OWN_INFO = "/camera/depth/image_rect_raw", "/camera/depth/camera_info"
WIDTH, HEIGHT = SIZE

Write = Callable[[Path, Iterable[Sent]], Path]


@pytest.fixture(params=WRITERS)
def write(request: pytest.FixtureRequest) -> Write:
    return WRITERS[request.param]


def color(k: int) -> np.ndarray:
    return np.random.default_rng(k).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)


def depth(k: int) -> np.ndarray:
    return np.random.default_rng(k).integers(500, 5000, (HEIGHT, WIDTH)).astype(np.uint16)


def frames(*, own_depth: bool = False) -> list[Sent]:
    """Raw images of a small camera; depth in the frame of colour, or in its own."""
    topic, info, frame = (
        (OWN_DEPTH, OWN_INFO, DEPTH_FRAME) if own_depth else (DEPTH, DEPTH_INFO, "")
    )
    where = {"frame": frame} if own_depth else {}
    sent = [camera_info(COLOR_INFO), camera_info(info, **where)]
    for k in range(FRAMES):
        sent.append(image(COLOR, k * STEP_NS, "rgb8", color(k)))
        sent.append(image(topic, k * STEP_NS, "16UC1", depth(k), **where))
    return sent


def imported(
    tmp_path: Path, sent: Iterable[Sent], write: Write = WRITERS["mcap"], **options: Any
) -> ImportedCapture:
    fixed_frame = options.pop("fixed_frame", None)
    path = write(tmp_path / "bag", sent)
    return import_recording(path, tmp_path / "out", TopicNames(**options), fixed_frame)


def refused(tmp_path: Path, sent: Iterable[Sent], **options: Any) -> str:
    """The error of an import that leaves nothing."""
    tmp_path.mkdir(exist_ok=True)
    with pytest.raises(VnavError) as error:
        imported(tmp_path, sent, **options)
    assert [path.name for path in tmp_path.iterdir()] == ["bag"]
    return str(error.value)


def replaced(sent: list[Sent], topic: str, number: int, **fields: object) -> list[Sent]:
    """The messages, some fields of one of a topic altered."""
    rows = [row for row, one in enumerate(sent) if one.topic == topic]
    altered = replace(sent[rows[number]], fields=sent[rows[number]].fields | fields)
    return [altered if row == rows[number] else one for row, one in enumerate(sent)]


def odometry_files(root: Path) -> dict[str, str]:
    """Hashes of what odometry makes of a capture, but for what names its files."""
    from vnav.io.store.map_folder import MapFolder
    from vnav.stages import odometry

    folder = MapFolder.create(root.with_name(f"map of {root.name}"))
    odometry.run(folder, open_capture(root, CaptureConfig()), Config())
    made = folder.root / "odometry"
    return {
        str(path.relative_to(made)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(made.rglob("*"))
        if path.is_file() and path.name != "stage.json"
    }


def test_a_bag_of_a_capture_makes_the_map_that_the_capture_makes(
    write: Write, tiny_capture: Path, tmp_path: Path
) -> None:
    source = shortened(tiny_capture, tmp_path / "source", FRAMES)
    found = imported(tmp_path, recorded(source, FRAMES), write)
    assert (found.color_images, found.depth_images, found.skipped) == (FRAMES, FRAMES, ())
    before, after = (open_capture(root, CaptureConfig()) for root in (source, found.folder))
    assert after.stamps_s.tolist() == before.stamps_s.tolist()
    for ours, theirs in zip(after.files.pairs, before.files.pairs, strict=True):
        assert ours.color.path.read_bytes() == theirs.color.path.read_bytes()
    assert odometry_files(found.folder) == odometry_files(source)


def test_raw_images_are_the_same_pixels_at_the_times_of_their_headers(
    write: Write, tmp_path: Path
) -> None:
    found = imported(tmp_path, frames(), write)
    assert (found.color, found.depth, found.camera_info) == (COLOR, DEPTH, COLOR_INFO)
    pairs = open_capture(found.folder, CaptureConfig()).files.pairs
    assert [pair.color.stamp_s for pair in pairs] == [k / 10 for k in range(FRAMES)]
    for k, pair in enumerate(pairs):
        assert (read_image(pair.color.path) == color(k)).all()
        assert pair.depth is not None
        assert (read_depth(pair.depth.path) == depth(k)).all()
    camera = read_camera(found.folder / "camera.toml")
    assert camera.color == CAMERA
    assert camera.is_registered
    assert camera.units_per_metre == 1000


def test_a_single_mcap_file_is_read_without_its_folder(tmp_path: Path) -> None:
    (path,) = WRITERS["mcap"](tmp_path / "bag", frames()).glob("*.mcap")
    assert import_recording(path, tmp_path / "out").color_images == FRAMES


def test_depth_in_floats_keeps_its_metres(tmp_path: Path) -> None:
    sent = [
        replace(one, fields=image(DEPTH, 0, "32FC1", np.full(SIZE[::-1], 2.5, np.float32)).fields)
        if one.topic == DEPTH
        else one
        for one in frames()
    ]
    found = imported(tmp_path, sent)
    frame = open_capture(found.folder, CaptureConfig()).read(0)
    assert np.abs(frame.depth_m[frame.depth_m > 0] - 2.5).max() < 1e-6


def test_colour_alone_is_a_capture_without_depth(tmp_path: Path) -> None:
    found = imported(tmp_path, [one for one in frames() if one.topic != DEPTH])
    assert (found.depth, found.depth_images) == ("", 0)
    assert not open_capture(found.folder, CaptureConfig()).has_depth


def test_raw_images_are_taken_before_the_same_compressed_and_colour_before_grey(
    tmp_path: Path,
) -> None:
    jpeg = cv2.imencode(".jpg", color(0))[1].tobytes()
    others = [
        compressed(f"{COLOR}/compressed", 0, "rgb8; jpeg compressed bgr8", jpeg),
        image("/camera/infra1/image_rect_raw", 0, "mono8", color(0)[..., 0]),
        image(OWN_DEPTH, 0, "16UC1", depth(0), frame=DEPTH_FRAME),
    ]
    found = imported(tmp_path, [*frames(), *others])
    assert (found.color, found.depth) == (COLOR, DEPTH)


def test_several_colour_topics_are_listed_with_the_option(tmp_path: Path) -> None:
    sent = [*frames(), image("/other/image_raw", 0, "bgr8", color(0))]
    assert f"found {COLOR} ({FRAMES}), /other/image_raw (1); name one with --color" in refused(
        tmp_path, sent
    )


def test_several_depth_topics_are_listed_with_the_option(tmp_path: Path) -> None:
    others = [image(f"/{name}/depth", 0, "16UC1", depth(0)) for name in "ab"]
    sent = [one for one in frames() if one.topic != DEPTH]
    assert "found /a/depth (1), /b/depth (1); name one with --depth" in refused(
        tmp_path, [*sent, *others]
    )


def test_named_topics_are_taken(tmp_path: Path) -> None:
    others = [
        image("/other/image_raw", 0, "bgr8", color(0)),
        image("/other/depth", 0, "16UC1", depth(0)),
        camera_info("/strange/place"),
    ]
    names = {"color": "/other/image_raw", "depth": "/other/depth", "camera_info": "/strange/place"}
    found = imported(tmp_path, [*frames(), *others], **names)
    assert (found.color, found.depth, found.camera_info) == tuple(names.values())
    assert found.color_images == 1


@pytest.mark.parametrize("option", ["color", "depth", "camera_info"])
def test_a_topic_that_is_not_there_is_told_with_those_that_are(option: str, tmp_path: Path) -> None:
    told = refused(tmp_path, frames(), **{option: "/nowhere"})
    assert told.startswith(f"expected the topic /nowhere of --{option.replace('_', '-')} in")
    assert "/camera/" in told


def test_images_without_a_camera_are_told(tmp_path: Path) -> None:
    sent = [one for one in frames() if one.topic not in (COLOR_INFO, DEPTH_INFO)]
    assert f"camera_info beside {COLOR} in" in refused(tmp_path, sent)


def test_a_camera_of_another_size_is_told_before_all_is_read(tmp_path: Path) -> None:
    half = Intrinsics(8, 6, 10.0, 10.0, 3.5, 2.5)
    sent = [camera_info(COLOR_INFO, camera=half), *frames()[2:]]
    assert f"images of 8 x 6 pixels in {COLOR}" in refused(tmp_path, sent)


def test_depth_in_its_own_frame_is_registered_by_the_robots_frames(tmp_path: Path) -> None:
    T_color_depth = se3.exp(np.array([0.01, 0.02, -0.01, -0.015, 0.001, 0.002]))
    T_link_color = se3.exp(np.array([1.2, -1.2, 1.2, 0.0, 0.02, 0.0]))
    tf = [
        transform("/tf_static", 0, "camera_link", "camera_color_optical_frame", T_link_color),
        transform("/tf_static", 0, "camera_link", DEPTH_FRAME, T_link_color @ T_color_depth),
    ]
    found = imported(tmp_path, [*frames(own_depth=True), *tf])
    camera = read_camera(found.folder / "camera.toml")
    assert found.depth == OWN_DEPTH
    np.testing.assert_allclose(camera.T_color_depth, T_color_depth, atol=1e-9)
    assert camera.depth is not None
    assert camera.depth.fx == CAMERA.fx + 1  # its images are rectified: P
    assert found.poses == 0  # nothing moves


def test_depth_from_an_unknown_place_is_refused(tmp_path: Path) -> None:
    told = refused(tmp_path, frames(own_depth=True))
    assert f"a transform between camera_color_optical_frame, of colour, and {DEPTH_FRAME}" in told


def test_depth_without_a_frame_is_registered_only_where_somebody_says_so(tmp_path: Path) -> None:
    sent = [
        replace(one, frame="", topic=one.topic.replace("aligned_depth_to_color", "depth"))
        for one in frames()
    ]
    assert "say so with --registered" in refused(tmp_path / "a", sent)
    (tmp_path / "b").mkdir()
    found = imported(tmp_path / "b", sent, is_registered=True)
    assert found.camera.is_registered


def test_a_recording_of_realsense_viewer_is_told_who_reads_it(tmp_path: Path) -> None:
    color_topic = "/device_0/sensor_1/Color_0/image/data"
    depth_topic = "/device_0/sensor_0/Depth_0/image/data"
    sent = [image(color_topic, 0, "rgb8", color(0)), image(depth_topic, 0, "mono16", depth(0))]
    assert 'RSBagReader.create("' in refused(tmp_path, sent)


def moving() -> list[Sent]:
    """The frames of a camera that a robot drives through a map."""
    sent = [
        *frames(),
        transform("/tf_static", 0, "base_link", "camera_color_optical_frame", np.eye(4)),
        transform("/tf_static", 0, "map", "odom", se3.make(np.eye(3), [5, 0, 0])),
    ]
    for k in range(2 * FRAMES - 4):  # the last images come after the last message
        T = se3.make(np.eye(3), [0.1 * k, 0, 0])
        sent.append(transform("/tf", k * STEP_NS // 2, "/odom", "/base_link", T))
    return sorted(sent, key=lambda one: one.stamp_ns)


def test_poses_of_the_camera_are_written_where_they_are_known(write: Write, tmp_path: Path) -> None:
    found = imported(tmp_path, moving(), write)
    trajectory = read_tum(found.folder / "trajectory.tum")
    assert (found.fixed_frame, found.poses) == ("map", 4)
    np.testing.assert_allclose(trajectory.stamps_s, [0, 0.1, 0.2, 0.3], atol=1e-9)
    np.testing.assert_allclose(trajectory.positions[:, 0], [5, 5.2, 5.4, 5.6], atol=1e-9)
    assert not (found.folder / "groundtruth.txt").exists()


def test_transforms_of_old_robots_are_read_as_those_of_today(tmp_path: Path) -> None:
    sent = [replace(one, kind=OLD_TF) if one.kind == TF else one for one in moving()]
    assert imported(tmp_path, sent, WRITERS["ros1"]).poses == 4


def test_the_frame_of_the_poses_may_be_named(tmp_path: Path) -> None:
    found = imported(tmp_path, moving(), fixed_frame="odom")
    trajectory = read_tum(found.folder / "trajectory.tum")
    np.testing.assert_allclose(trajectory.positions[:, 0], [0, 0.2, 0.4, 0.6], atol=1e-9)


def test_a_frame_that_is_not_above_the_camera_is_refused(tmp_path: Path) -> None:
    told = refused(tmp_path, moving(), fixed_frame="earth")
    assert "above it are base_link, odom, map" in told


def test_a_damaged_message_is_named_and_the_others_are_taken(write: Write, tmp_path: Path) -> None:
    sent = replaced(frames(), COLOR, 2, step=3)
    found = imported(tmp_path, replaced(sent, DEPTH, 0, data=np.zeros(7, np.uint8)), write)
    assert (found.color_images, found.depth_images) == (FRAMES - 1, FRAMES - 1)
    assert found.skipped_count == 2
    assert found.skipped[0].startswith(f"image 0 of {DEPTH} is skipped: expected 12 rows")
    assert found.skipped[1].startswith(f"image 2 of {COLOR} is skipped: expected 12 rows")


def test_an_image_of_another_size_and_one_of_the_same_time_are_skipped(tmp_path: Path) -> None:
    other = image(COLOR, 0, "rgb8", np.zeros((4, 4, 3), np.uint8))
    sent = replaced(frames(), COLOR, 3, **other.fields)
    found = imported(tmp_path, [*sent, frames()[-2]])
    assert found.color_images == FRAMES - 1
    assert "expected 16 x 12 pixels, as its camera has, found 4 x 4" in found.skipped[0]
    assert "found 0.500000000 s, that of an image before" in found.skipped[1]


def test_where_no_image_is_whole_the_first_is_told(tmp_path: Path) -> None:
    sent = frames()
    for number in range(FRAMES):
        sent = replaced(sent, COLOR, number, height=2**31)
    told = refused(tmp_path, sent)
    assert f"found none of {FRAMES} that can be used; the first: image 0 of {COLOR}" in told


def test_an_unknown_encoding_is_told(tmp_path: Path) -> None:
    sent = [
        replace(one, fields=one.fields | {"encoding": "yuv422"}) if one.topic == COLOR else one
        for one in frames()
    ]
    assert "found 'yuv422'" in refused(tmp_path, sent)


def test_a_camera_that_changes_is_counted(tmp_path: Path) -> None:
    other = replace(CAMERA, fx=25.0)
    sent = [*frames(), camera_info(COLOR_INFO), camera_info(COLOR_INFO, camera=other)]
    assert imported(tmp_path, sent).other_cameras == 1


def test_a_bag_without_images_is_told_with_what_it_has(tmp_path: Path) -> None:
    assert f"expected images in {tmp_path / 'bag'}, found {COLOR_INFO} (1)" in refused(
        tmp_path, [camera_info(COLOR_INFO)]
    )


@pytest.mark.parametrize("share", [0.3, 0.9])
def test_a_truncated_bag_is_told_and_nothing_is_left(
    share: float, write: Write, tmp_path: Path
) -> None:
    path = write(tmp_path / "bag", frames())
    file = path if path.is_file() else next(f for f in path.iterdir() if f.suffix != ".yaml")
    file.write_bytes(file.read_bytes()[: int(share * file.stat().st_size)])
    with pytest.raises(CaptureError, match="expected a whole recording in .*repair it with"):
        import_recording(path, tmp_path / "out")
    assert [left.name for left in tmp_path.iterdir()] == [path.name]


def test_altered_bytes_of_a_bag_are_told_or_named(write: Write, tmp_path: Path) -> None:
    """Wherever they are: an error of ours, or a capture; nothing else is raised."""
    rng = np.random.default_rng(0)
    path = write(tmp_path / "bag", frames())
    file = path if path.is_file() else next(f for f in path.iterdir() if f.suffix != ".yaml")
    whole = np.frombuffer(file.read_bytes(), np.uint8)
    for k in range(20):
        spoilt = whole.copy()
        spoilt[rng.integers(0, len(whole), 8)] = rng.integers(0, 256, 8)
        file.write_bytes(spoilt.tobytes())
        try:
            found = import_recording(path, tmp_path / f"out{k}")
        except (CaptureError, CameraError):
            assert not (tmp_path / f"out{k}").exists()
        else:
            assert found.color_images <= FRAMES


def test_a_capture_folder_needs_no_import(tiny_capture: Path, tmp_path: Path) -> None:
    with pytest.raises(CaptureError, match=r"capture folder \(TUM RGB-D\).*'vnav build-map"):
        import_recording(tiny_capture, tmp_path / "out")


@pytest.mark.parametrize("name", ["nothing.bag", "notes.txt", "folder"])
def test_what_is_no_recording_is_told(name: str, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").touch()
    (tmp_path / "folder").mkdir()
    found = "found (nothing|something else|a folder without metadata.yaml)"
    with pytest.raises(CaptureError, match=f"expected a recording at .*{found}"):
        import_recording(tmp_path / name, tmp_path / "out")


def test_without_the_library_what_to_install_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = WRITERS["ros1"](tmp_path / "bag", frames())
    monkeypatch.setitem(sys.modules, "rosbags", None)
    with pytest.raises(CaptureError, match=r"pip install vnav-rgbd\[ros\]"):
        import_recording(path, tmp_path / "out")
