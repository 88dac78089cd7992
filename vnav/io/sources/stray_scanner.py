"""Stray Scanner's folders: rgb.mp4, depth/, confidence/, odometry.csv, camera_matrix.csv.

Depth is in millimetres; a line of odometry.csv tells a frame's time, number and pose, and in newer
versions its camera. Poses are of a camera whose z points forward.

Source: https://github.com/strayrobots/scanner, docs/format.md; StrayVisualizer.
"""

import csv
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from vnav.config import CaptureConfig
from vnav.core import se3
from vnav.core.camera import Intrinsics, registered_camera
from vnav.core.trajectory import Trajectory
from vnav.errors import CameraError, CaptureError, TrajectoryError
from vnav.io.cameras.tables import from_corner, is_number, pinhole
from vnav.io.files import read_text
from vnav.io.formats.images import first_size
from vnav.io.formats.video import frame_count, video_size
from vnav.io.sources.arkit import MILLIMETRES, upright
from vnav.io.sources.frame_list import FrameList, FramePair, ImageFile
from vnav.io.sources.tum import read_truth as read_truth  # groundtruth.txt, as there
from vnav.io.sources.tum import truth_path as truth_path

NAME = "Stray Scanner"
LAYOUT = "rgb.mp4, depth/ and odometry.csv"

_VIDEO, _ODOMETRY, _MATRIX = "rgb.mp4", "odometry.csv", "camera_matrix.csv"
_POSITION, _QUATERNION = ("x", "y", "z"), ("qx", "qy", "qz", "qw")
_TOLD = ("timestamp", "frame", *_POSITION, *_QUATERNION)
_CAMERA = ("fx", "fy", "cx", "cy")
_UNIT = 0.01  # how far a quaternion's length may lie from 1: printed digits

Row = Mapping[str, float]  # of odometry.csv, by the names in its head


def recognises(root: Path) -> bool:
    """Whether the folder has the video and the odometry."""
    return (root / _VIDEO).is_file() and (root / _ODOMETRY).is_file()


def list_frames(root: Path, config: CaptureConfig) -> FrameList:
    """The frames of the video that have depth, with their cameras and poses."""
    rows, count = _rows(root / _ODOMETRY), frame_count(root / _VIDEO)
    filmed = [row for row in rows if row["frame"] < count]
    measured = {row["frame"] for row in rows if _image(root, "depth", row).path.is_file()}
    seen = [row for row in filmed if row["frame"] in measured]
    if not seen:
        raise CaptureError(
            f"expected depth images such as depth/000000.png in {root}, one a frame of {_VIDEO},"
            f" found none for {len(filmed)} frames; record with a phone that has a LiDAR"
        )
    depths = [_image(root, "depth", row) for row in seen]
    depth_size = first_size(depth.path for depth in depths)
    if depth_size is None:
        raise CaptureError(f"expected depth images in {root}, found none that can be read")
    colors = _cameras(root, seen)
    has_confidence = (root / "confidence").is_dir()
    pairs = [
        FramePair(
            _filmed(root, row),
            depth,
            _image(root, "confidence", row) if has_confidence else None,
            registered_camera(color, MILLIMETRES, depth_size),
        )
        for row, depth, color in zip(seen, depths, colors, strict=True)
    ]
    return FrameList(
        tuple(pairs),
        tuple(_filmed(root, row) for row in filmed if row["frame"] not in measured),
        tuple(_image(root, "depth", row) for row in rows if count <= row["frame"] in measured),
        _poses(root / _ODOMETRY, seen),
    )


def _rows(path: Path) -> list[Row]:
    """Lines by time, one a time; CaptureError names a line that is none."""
    try:
        head, *lines = list(csv.reader(read_text(path).splitlines()))
    except (OSError, UnicodeDecodeError, ValueError, csv.Error) as error:
        raise CaptureError(f"expected the frames' times and poses in {path}: {error}") from error
    names = [name.strip() for name in head]
    rows: dict[float, Row] = {}
    for number, words in enumerate(lines, 2):
        row = {name: _number(word) for name, word in zip(names, words, strict=False)}
        if not all(is_number(row.get(name)) for name in _TOLD) or row["frame"] < 0:
            raise CaptureError(
                f"expected {', '.join(_TOLD)} in {path}, line {number}, found {','.join(words)}"
            )
        rows.setdefault(row["timestamp"], row)
    return [rows[stamp_s] for stamp_s in sorted(rows)]


def _number(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        return float("nan")


def _filmed(root: Path, row: Row) -> ImageFile:
    return ImageFile(row["timestamp"], root / _VIDEO, int(row["frame"]))


def _image(root: Path, kind: str, row: Row) -> ImageFile:
    return ImageFile(row["timestamp"], root / kind / f"{int(row['frame']):06d}.png")


def _cameras(root: Path, rows: list[Row]) -> list[Intrinsics]:
    """The colour camera of each frame: its own, else that of all; CameraError as `read_camera`."""
    size = video_size(root / _VIDEO)
    own = [{key: row[key] for key in _CAMERA if is_number(row.get(key))} for row in rows]
    if any(len(values) < len(_CAMERA) for values in own):
        own = [_matrix(root / _MATRIX)] * len(rows)
    colors = [Intrinsics(*size, **from_corner(values)) for values in own]
    for color in colors:
        if not color.is_possible:
            raise CameraError(f"expected a possible camera in {root}, found {color}")
    return colors


def _matrix(path: Path) -> dict[str, float]:
    try:
        words = [word for line in read_text(path).splitlines() for word in line.split(",")]
        return pinhole([float(word) for word in words if word.strip()])
    except (OSError, ValueError) as error:
        raise CameraError(f"expected a camera matrix in {path}, found: {error}") from error


def _poses(path: Path, rows: list[Row]) -> Trajectory:
    """Poses of the colour camera; TrajectoryError where one is no rotation."""
    quat_xyzw = np.array([[row[key] for key in _QUATERNION] for row in rows])
    wrong = np.flatnonzero(abs(np.linalg.norm(quat_xyzw, axis=1) - 1) > _UNIT)
    if len(wrong):
        raise TrajectoryError(
            f"expected unit quaternions in {path}, found {quat_xyzw[wrong[0]].tolist()} of frame"
            f" {rows[wrong[0]]['frame']:g}"
        )
    positions = np.array([[row[key] for key in _POSITION] for row in rows])
    T_arkit_camera = se3.make(se3.rotation_from_quat(quat_xyzw), positions)
    return Trajectory(np.array([row["timestamp"] for row in rows]), upright(T_arkit_camera))
