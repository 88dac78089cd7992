"""Bags of ROS 1 and ROS 2 and MCAP files, read message by message; rosbags is known here alone.

Formats: wiki.ros.org/Bags/Format/2.0, github.com/ros2/rosbag2 (sqlite3 and mcap storage),
mcap.dev/spec. Messages are decoded as ROS defines their types, whatever definition a bag brings.
"""

import struct
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vnav.core import se3
from vnav.core.frame import Rejected
from vnav.errors import CaptureError
from vnav.io.recordings.ros_messages import (
    RosCameraInfo,
    RosCompressedImage,
    RosImage,
    RosMessage,
    RosTransform,
)

SUFFIXES = (".bag", ".mcap", ".db3")
METADATA = "metadata.yaml"  # of a folder that is a bag of ROS 2

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
_OLD_TRANSFORMS = "tf/msg/tfMessage"  # of ROS before 2012, with the same content

# What is raised where bytes are not what they should be, by rosbags and what it stands on.
_DAMAGED = (
    *(ArithmeticError, AssertionError, AttributeError, EOFError, LookupError, OSError),
    *(MemoryError, RuntimeError, TypeError, ValueError, struct.error),
)


@dataclass(frozen=True)
class RosTopic:
    """What was published under a name."""

    name: str
    kind: str  # the type of its messages
    count: int


def is_ros_bag(path: Path) -> bool:
    """Whether a path is called like a bag, or is a folder with the metadata of one."""
    return (path / METADATA).is_file() if path.is_dir() else path.suffix in SUFFIXES


class RosBag:
    """An open bag: its topics, and their messages in the order in which they were recorded."""

    def __init__(self, path: Path, reader: Any, library: "_Rosbags", is_ros1: bool) -> None:
        self.path, self._reader, self._library = path, reader, library
        self._decode = library.decoder(is_ros1)
        counts: dict[tuple[str, str], int] = {}
        for connection in filter(_is_read, reader.connections):
            key = connection.topic, _kind(connection)
            counts[key] = counts.get(key, 0) + connection.msgcount
        self.topics = tuple(
            RosTopic(name, kind, count) for (name, kind), count in sorted(counts.items()) if count
        )

    def of_kind(self, *kinds: str) -> list[RosTopic]:
        """The topics whose messages are of one of some types."""
        return [topic for topic in self.topics if topic.kind in kinds]

    def messages(self, names: Collection[str]) -> Iterator[tuple[str, RosMessage | Rejected]]:
        """Topic and content of each message of some topics; Rejected says why it has none.

        CaptureError where the bag itself is damaged.
        """
        chosen = [c for c in self._reader.connections if c.topic in names and _is_read(c)]
        stream = iter(self._reader.messages(chosen) if chosen else ())
        while True:
            with _told_of(self.path, self._library.damaged):
                found = next(stream, None)
            if found is None:
                return
            connection, _, data = found
            yield connection.topic, self._content(data, _kind(connection))

    def first(self, name: str) -> RosMessage | None:
        """The first whole message of a topic, None where there is none."""
        contents = (content for _, content in self.messages([name]))
        return next((content for content in contents if not isinstance(content, Rejected)), None)

    def _content(self, data: bytes, kind: str) -> RosMessage | Rejected:
        try:
            return _PARSERS[kind](self._decode(data, kind))
        except self._library.damaged as error:
            return Rejected(f"expected a message of type {kind}, found: {error}")


@contextmanager
def open_bag(path: Path) -> Iterator[RosBag]:
    """A bag to read; CaptureError where there is none, it is damaged, or rosbags is missing."""
    if not is_ros_bag(path) or not (path.is_dir() or path.is_file()):
        other = f"a folder without {METADATA}" if path.is_dir() else "something else"
        found = other if path.exists() else "nothing"
        raise CaptureError(
            f"expected a recording at {path}, that is a .bag (ROS 1), an .mcap or .db3 (ROS 2), or"
            f" a folder with {METADATA} (ROS 2), found {found}"
        )
    library, is_ros1 = _Rosbags(), path.suffix == ".bag" and path.is_file()
    with _told_of(path, library.damaged):
        reader = (library.Reader1 if is_ros1 else library.Reader2)(path)
        reader.open()
    try:
        yield RosBag(path, reader, library, is_ros1)
    finally:
        reader.close()


class _Rosbags:
    """The parts of rosbags that are used here; CaptureError where it is not installed."""

    def __init__(self) -> None:
        try:
            import apsw
            from rosbags import rosbag1, rosbag2, serde, typesys
            from rosbags.rosbag2.reader import zstd
        except ImportError as error:
            raise CaptureError(
                "expected rosbags to read a recording of ROS, found it not installed; run"
                " 'pip install vnav-rgbd[ros]'"
            ) from error
        self._typesys = typesys
        self.Reader1, self.Reader2 = rosbag1.Reader, rosbag2.Reader
        self.damaged: tuple[type[Exception], ...] = (
            *(rosbag1.ReaderError, rosbag2.ReaderError, serde.SerdeError),
            *(apsw.Error, zstd.ZstdError),
            *_DAMAGED,
        )

    def decoder(self, is_ros1: bool) -> Callable[[bytes, str], Any]:
        """What makes a message of bytes and the name of its type."""
        stores = self._typesys.Stores
        store = self._typesys.get_typestore(stores.ROS1_NOETIC if is_ros1 else stores.LATEST)
        if TRANSFORMS not in store.fielddefs:
            text = "geometry_msgs/TransformStamped[] transforms"
            store.register(self._typesys.get_types_from_msg(text, TRANSFORMS))
        decode: Callable[[bytes, str], Any] = (
            store.deserialize_ros1 if is_ros1 else store.deserialize_cdr
        )
        return decode


@contextmanager
def _told_of(path: Path, damaged: tuple[type[Exception], ...]) -> Iterator[None]:
    """CaptureError in the place of all that a damaged bag may raise."""
    try:
        yield
    except damaged as error:
        found = str(error) or type(error).__name__
        if isinstance(error, MemoryError):
            found = "a record larger than memory"
        raise CaptureError(
            f"expected a whole recording in {path}, found: {found}; if it is damaged,"
            " repair it with 'rosbag reindex' (ROS 1), 'ros2 bag reindex' (ROS 2) or 'mcap recover'"
        ) from error


def _kind(connection: Any) -> str:
    """The type of a connection's messages, by its name of today."""
    return TRANSFORMS if connection.msgtype == _OLD_TRANSFORMS else str(connection.msgtype)


def _is_read(connection: Any) -> bool:
    """Whether its messages are of a type that is needed, and written as ROS does."""
    is_cdr = getattr(connection.ext, "serialization_format", "cdr") == "cdr"
    return is_cdr and _kind(connection) in _PARSERS


def _stamp_ns(stamp: Any) -> int:
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def _frame(name: str) -> str:
    """A frame without the leading slash that ROS 1 allowed."""
    return name.lstrip("/")


def _image(message: Any) -> RosImage:
    header = message.header
    return RosImage(
        _stamp_ns(header.stamp),
        _frame(header.frame_id),
        message.encoding,
        message.width,
        message.height,
        message.step,
        bool(message.is_bigendian),
        message.data,
    )


def _compressed(message: Any) -> RosCompressedImage:
    header = message.header
    encoding, semicolon, codec = message.format.partition(";")
    if not semicolon:
        encoding, codec = "", message.format
    return RosCompressedImage(
        _stamp_ns(header.stamp),
        _frame(header.frame_id),
        encoding.strip(),
        codec.strip(),
        message.data,
    )


def _camera_info(message: Any) -> RosCameraInfo:
    D, K, P = (
        tuple(map(float, getattr(message, name, getattr(message, name.upper(), ()))))
        for name in "dkp"
    )
    roi, size = message.roi, (message.width, message.height)
    is_part = (
        max(message.binning_x, message.binning_y) > 1
        or (roi.x_offset, roi.y_offset) != (0, 0)
        or (roi.width, roi.height) not in ((0, 0), size)
    )
    frame = _frame(message.header.frame_id)
    return RosCameraInfo(frame, *size, message.distortion_model, D, K, P, is_part)


def _transforms(message: Any) -> tuple[RosTransform, ...]:
    return tuple(_transform(stamped) for stamped in message.transforms)


def _transform(stamped: Any) -> RosTransform:
    t, q = stamped.transform.translation, stamped.transform.rotation
    quat_xyzw = np.array([q.x, q.y, q.z, q.w])
    if not np.linalg.norm(quat_xyzw) > 0 or not np.isfinite([*quat_xyzw, t.x, t.y, t.z]).all():
        raise ValueError(f"a rotation that is none: {quat_xyzw}")
    return RosTransform(
        _stamp_ns(stamped.header.stamp),
        _frame(stamped.header.frame_id),
        _frame(stamped.child_frame_id),
        se3.make(se3.rotation_from_quat(quat_xyzw), [t.x, t.y, t.z]),
    )


_PARSERS: dict[str, Callable[[Any], RosMessage]] = {
    IMAGE: _image,
    COMPRESSED: _compressed,
    CAMERA_INFO: _camera_info,
    TRANSFORMS: _transforms,
}
