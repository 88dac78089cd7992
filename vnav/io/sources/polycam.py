"""Polycam's raw export: keyframes/images, depth, confidence and cameras, one file of each a frame.

Files are named by their time in microseconds. Depth is in millimetres; a camera file holds the
frame's intrinsics, and its pose as t_00 to t_23, of a camera whose y points up and z backwards.
Where Polycam has optimised the poses, they lie in corrected_cameras.

Source: https://learn.poly.cam (raw data export), polycam_utils.py of nerfstudio, and exports.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vnav.config import CaptureConfig
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics, registered_camera
from vnav.core.trajectory import Trajectory
from vnav.errors import CameraError, CaptureError, TrajectoryError
from vnav.io.cameras.tables import from_corner, is_number
from vnav.io.files import read_text
from vnav.io.formats.images import first_size
from vnav.io.sources.arkit import MILLIMETRES, upright
from vnav.io.sources.frame_list import FrameList, FramePair, ImageFile
from vnav.io.sources.tum import read_truth as read_truth  # groundtruth.txt, as there
from vnav.io.sources.tum import truth_path as truth_path

NAME = "Polycam"
LAYOUT = "keyframes/images, keyframes/depth and keyframes/cameras"

_IMAGES, _DEPTH = Path("keyframes/images"), Path("keyframes/depth")
_CONFIDENCE = Path("keyframes/confidence")
_CAMERAS, _CORRECTED = Path("keyframes/cameras"), Path("keyframes/corrected_cameras")
_SUFFIXES = (".jpg", ".jpeg", ".png")
_PINHOLE = ("width", "height", "fx", "fy", "cx", "cy")
_T_GL_CV = np.diag([1.0, -1.0, -1.0, 1.0])  # y down and z forward, in y up and z backwards
_ROUNDED = 1e-3  # how far a printed rotation may be from orthonormal

Values = Mapping[str, Any]  # of a camera file


def recognises(root: Path) -> bool:
    """Whether the folder has Polycam's images."""
    return (root / _IMAGES).is_dir()


def list_frames(root: Path, config: CaptureConfig) -> FrameList:
    """The images that have depth and a camera, with their cameras and poses."""
    colors = _colors(root / _IMAGES, config)
    whole = [color for color in colors if all(path.is_file() for path in _needed(root, color))]
    depth_size = first_size(_beside(root, _DEPTH, color).path for color in whole)
    if depth_size is None:
        raise CaptureError(
            f"expected images with depth and cameras of the same names in {root / 'keyframes'},"
            f" found none among {len(colors)} images; export raw data of a LiDAR scan"
        )
    has_confidence = (root / _CONFIDENCE).is_dir()
    pairs = [
        FramePair(
            color,
            _beside(root, _DEPTH, color),
            _beside(root, _CONFIDENCE, color) if has_confidence else None,
            registered_camera(_intrinsics(_file(root, _CAMERAS, color)), MILLIMETRES, depth_size),
        )
        for color in whole
    ]
    used = set(whole)
    dropped = tuple(color for color in colors if color not in used)
    return FrameList(tuple(pairs), dropped, poses=_poses(root, whole))


def _colors(folder: Path, config: CaptureConfig) -> list[ImageFile]:
    """Images by time, one a time: that of their names, or by order where these are no numbers."""
    paths = sorted(path for path in folder.iterdir() if path.suffix.lower() in _SUFFIXES)
    stamps_s = [k / config.frame_rate_hz for k in range(len(paths))]
    if all(path.stem.isdecimal() for path in paths):
        stamps_s = [int(path.stem) / 1e6 for path in paths]
    by_stamp = {s: ImageFile(s, path) for s, path in zip(stamps_s, paths, strict=True)}
    return [by_stamp[s] for s in sorted(by_stamp)]


def _needed(root: Path, color: ImageFile) -> tuple[Path, Path]:
    return _beside(root, _DEPTH, color).path, _file(root, _CAMERAS, color)


def _beside(root: Path, folder: Path, color: ImageFile) -> ImageFile:
    return ImageFile(color.stamp_s, root / folder / f"{color.path.stem}.png")


def _file(root: Path, folder: Path, color: ImageFile) -> Path:
    return root / folder / f"{color.path.stem}.json"


def _values(path: Path, keys: Sequence[str]) -> Values:
    """What a camera file says; CameraError where one of these numbers is not among it."""
    try:
        values = json.loads(read_text(path))
    except (OSError, ValueError, RecursionError) as error:
        raise CameraError(f"expected a camera of Polycam in {path}, found: {error}") from error
    if not isinstance(values, dict) or not all(is_number(values.get(key)) for key in keys):
        raise CameraError(
            f"expected the numbers {', '.join(keys)} in {path}, found them missing or no numbers;"
            " remove its image"
        )
    return values


def _intrinsics(path: Path) -> Intrinsics:
    values = from_corner(_values(path, _PINHOLE))
    width, height, fx, fy, cx, cy = (values[key] for key in _PINHOLE)
    color = Intrinsics(int(width), int(height), float(fx), float(fy), float(cx), float(cy))
    if not color.is_possible:
        raise CameraError(f"expected a possible camera in {path}, found {color}; remove its image")
    return color


def _poses(root: Path, colors: list[ImageFile]) -> Trajectory:
    """Poses of the colour camera, optimised ones where there are some; others are left out."""
    folder = _CORRECTED if (root / _CORRECTED).is_dir() else _CAMERAS
    posed = {color.stamp_s: _file(root, folder, color) for color in colors}
    posed = {stamp_s: path for stamp_s, path in posed.items() if path.is_file()}
    T_arkit_camera = np.array([_pose(path) for path in posed.values()]).reshape(-1, 4, 4)
    return Trajectory(np.array(list(posed)), upright(T_arkit_camera))


def _pose(path: Path) -> Array:
    keys = [f"t_{row}{column}" for row in range(3) for column in range(4)]
    values = _values(path, keys)
    T_arkit_gl = np.eye(4)
    T_arkit_gl[:3] = np.array([values[key] for key in keys]).reshape(3, 4)
    if not se3.is_rigid(T_arkit_gl, _ROUNDED):
        raise TrajectoryError(
            f"expected a rotation and a translation as t_00 to t_23 in {path}, found"
            f" {T_arkit_gl[:3].tolist()}"
        )
    return np.asarray(se3.orthonormal(T_arkit_gl) @ _T_GL_CV)
