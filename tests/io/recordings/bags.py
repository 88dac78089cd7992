"""Bags as robots record them, written by rosbags' own writers."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.io.formats.camera_file import read_camera
from vnav.io.formats.images import read_depth

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
INFO, TF = "sensor_msgs/msg/CameraInfo", "tf2_msgs/msg/TFMessage"
OLD_TF = "tf/msg/tfMessage"  # of ROS 1 before tf2
COLOR, DEPTH = "/camera/color/image_raw", "/camera/aligned_depth_to_color/image_raw"
COLOR_INFO, DEPTH_INFO = "/camera/color/camera_info", "/camera/aligned_depth_to_color/camera_info"
FRAME = "camera_color_optical_frame"
SIZE = (16, 12)
CAMERA = Intrinsics(*SIZE, 20.0, 21.0, 7.5, 5.5, (0.1, -0.05, 0.001, 0.002, 0.01))


@dataclass(frozen=True)
class Sent:
    """A message: its topic, its type, what is in it, when it is recorded."""

    topic: str
    kind: str
    fields: dict[str, Any] = field(repr=False)
    stamp_ns: int
    frame: str = FRAME


def image(
    topic: str,
    stamp_ns: int,
    encoding: str,
    pixels: np.ndarray,
    *,
    frame: str = FRAME,
    **other: Any,
) -> Sent:
    """A raw image; ``other`` fields replace those that fit."""
    height, width = pixels.shape[:2]
    fields = {
        "height": height,
        "width": width,
        "encoding": encoding,
        "is_bigendian": 0,
        "step": pixels.strides[0],
        "data": np.frombuffer(pixels.tobytes(), np.uint8),
    }
    return Sent(topic, IMAGE, fields | other, stamp_ns, frame)


def compressed(topic: str, stamp_ns: int, form: str, data: bytes, frame: str = FRAME) -> Sent:
    """An image file, or whatever else."""
    fields = {"format": form, "data": np.frombuffer(data, np.uint8)}
    return Sent(topic, COMPRESSED, fields, stamp_ns, frame)


def camera_info(
    topic: str, stamp_ns: int = 0, camera: Intrinsics = CAMERA, frame: str = FRAME, **other: Any
) -> Sent:
    """A camera's calibration; P is that of another focal length, as of rectified images."""
    P = np.zeros((3, 4))
    P[:, :3] = camera.K
    P[0, 0] += 1
    roi = {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False}
    fields = {
        "height": camera.height,
        "width": camera.width,
        "distortion_model": "plumb_bob",
        "d": np.array(camera.distortion or [0.0] * 5),
        "k": camera.K.ravel(),
        "r": np.eye(3).ravel(),
        "p": P.ravel(),
        "binning_x": 0,
        "binning_y": 0,
        "roi": SimpleNamespace(**roi),
    }
    return Sent(topic, INFO, fields | other, stamp_ns, frame)


def transform(topic: str, stamp_ns: int, parent: str, child: str, T: np.ndarray) -> Sent:
    """T_parent_child at a time."""
    t, q = T[:3, 3], se3.quat_xyzw(T)
    vector = SimpleNamespace(x=t[0], y=t[1], z=t[2])
    quaternion = SimpleNamespace(x=q[0], y=q[1], z=q[2], w=q[3])
    stamped = SimpleNamespace(
        header=_header(stamp_ns, parent),
        child_frame_id=child,
        transform=SimpleNamespace(translation=vector, rotation=quaternion),
    )
    return Sent(topic, TF, {"transforms": [stamped]}, stamp_ns)


def write_ros1(path: Path, sent: Iterable[Sent]) -> Path:
    """A bag of ROS 1; its path."""
    store = get_typestore(Stores.ROS1_NOETIC)
    for kind in (TF, OLD_TF):
        text = "geometry_msgs/TransformStamped[] transforms"
        store.register(get_types_from_msg(text, kind))
    path = path.with_suffix(".bag")
    with rosbag1.Writer(path) as writer:
        add = partial(writer.add_connection, typestore=store)
        _write_all(writer, add, lambda *one: store.serialize_ros1(*one), sent, is_ros1=True)
    return path


def write_ros2(plugin: rosbag2.StoragePlugin, path: Path, sent: Iterable[Sent]) -> Path:
    """A bag of ROS 2; its folder."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    with rosbag2.Writer(path, version=9, storage_plugin=plugin) as writer:
        add = partial(writer.add_connection, typestore=store)
        _write_all(writer, add, lambda *one: store.serialize_cdr(*one), sent, is_ros1=False)
    return path


WRITERS: dict[str, Callable[[Path, Iterable[Sent]], Path]] = {
    "ros1": write_ros1,
    "sqlite": partial(write_ros2, rosbag2.StoragePlugin.SQLITE3),
    "mcap": partial(write_ros2, rosbag2.StoragePlugin.MCAP),
}


def _write_all(
    writer: Any, add: Callable[..., Any], to_bytes: Callable[..., Any], sent: Any, *, is_ros1: bool
) -> None:
    connections: dict[str, Any] = {}
    for one in sent:
        if one.topic not in connections:
            connections[one.topic] = add(one.topic, one.kind)
        fields = dict(one.fields)
        if "transforms" not in fields:
            fields["header"] = _header(one.stamp_ns, one.frame)
        if one.kind == INFO and is_ros1:
            fields |= {name.upper(): fields.pop(name) for name in "dkrp"}
        # It arrives a little late, as on a robot.
        data = to_bytes(SimpleNamespace(**fields), one.kind)
        writer.write(connections[one.topic], one.stamp_ns + 3_000_000, data)


def _header(stamp_ns: int, frame: str) -> Any:
    stamp = SimpleNamespace(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return SimpleNamespace(seq=0, stamp=stamp, frame_id=frame)


def recorded(capture: Path, count: int) -> list[Sent]:
    """The first frames of a TUM folder as a camera driver sends them: JPEG files, depth in mm."""
    camera = read_camera(capture / "camera.toml")
    sent = [camera_info(COLOR_INFO, _first_ns(capture), camera.color)]
    for stamp_ns, path in _listed(capture / "rgb.txt", count):
        form = "rgb8; jpeg compressed bgr8"
        sent.append(compressed(f"{COLOR}/compressed", stamp_ns, form, path.read_bytes()))
    for stamp_ns, path in _listed(capture / "depth.txt", count):
        millimetres = np.rint(read_depth(path) * (1000 / camera.units_per_metre))
        sent.append(image(DEPTH, stamp_ns, "16UC1", millimetres.astype(np.uint16)))
    return sorted(sent, key=lambda one: one.stamp_ns)


def shortened(capture: Path, folder: Path, count: int) -> Path:
    """The first frames of a TUM folder as a capture of their own, its depth in millimetres."""
    for kind in ("rgb", "depth"):
        (folder / kind).mkdir(parents=True)
        lines = [
            f"{ns / 10**9:.9f} {kind}/{ns}{path.suffix}\n"
            for ns, path in _listed(capture / f"{kind}.txt", count)
        ]
        (folder / f"{kind}.txt").write_text("".join(lines))
        for ns, path in _listed(capture / f"{kind}.txt", count):
            target = folder / kind / f"{ns}{path.suffix}"
            if kind == "rgb":
                target.write_bytes(path.read_bytes())
            else:
                cv2.imwrite(str(target), read_depth(path) // 5)
    text = (capture / "camera.toml").read_text()
    (folder / "camera.toml").write_text(text.replace("= 5000", "= 1000"))
    return folder


def _listed(path: Path, count: int) -> list[tuple[int, Path]]:
    rows = [line.split() for line in path.read_text().splitlines() if line[0] != "#"][:count]
    return [(round(float(stamp) * 1e6) * 1000, path.parent / name) for stamp, name in rows]


def _first_ns(capture: Path) -> int:
    return _listed(capture / "rgb.txt", 1)[0][0]
