"""Folders of image files as captures: the format is recognised, the camera found.

A new format is one module like `vnav.io.sources.tum` and its name in `FORMATS`.
"""

import dataclasses
from pathlib import Path
from typing import Protocol

from vnav.config import CaptureConfig
from vnav.core.camera import LEAST, Camera
from vnav.core.trajectory import Trajectory
from vnav.errors import CameraError, CaptureError, ConfigError, TrajectoryError
from vnav.io.cameras.tool_files import files_beside
from vnav.io.formats.camera_file import preset_path, read_camera
from vnav.io.formats.trajectories import read_tum
from vnav.io.recordings.ros_bag import is_ros_bag
from vnav.io.sources import color_depth, polycam, seven_scenes, stray_scanner, tum, videos
from vnav.io.sources.folder_capture import FolderCapture
from vnav.io.sources.frame_list import FrameList
from vnav.io.sources.proposed_camera import no_camera


class CaptureFormat(Protocol):
    """What a module that knows one format of capture folders offers."""

    NAME: str
    LAYOUT: str  # what its folder holds, for messages

    def recognises(self, root: Path) -> bool:
        """Whether the folder looks like this format."""

    def list_frames(self, root: Path, config: CaptureConfig) -> FrameList:
        """Its frames; CaptureError where there are none."""

    def truth_path(self, root: Path, frames: FrameList) -> Path | None:
        """Where the true trajectory lies, None where there is none."""

    def read_truth(self, path: Path, frames: FrameList, camera: Camera) -> Trajectory:
        """The true trajectory of the colour camera; for scoring only."""


FORMATS: tuple[CaptureFormat, ...] = (
    tum,
    seven_scenes,
    stray_scanner,
    polycam,
    color_depth,
    videos,
)


def open_capture(
    path: Path, config: CaptureConfig, camera_file: Path | None = None
) -> FolderCapture:
    """The capture in a folder, read by the format that recognises it.

    Its camera comes from ``camera_file``, else camera.toml in the folder, else the frames
    themselves, else the file that a tool left there, else the preset that ``config.preset_camera``
    names; ``config.units_per_metre`` above 0 replaces the camera's. CaptureError where there is no
    capture, CameraError where there is no camera.
    """
    reader = _format_of(path)
    frames = reader.list_frames(path, config)
    camera, frames = _taken(path, config, camera_file, frames)
    return FolderCapture(path, camera, frames, reader.truth_path(path, frames))


def truth_of(path: Path, config: CaptureConfig) -> Path | None:
    """Where the true trajectory of a capture lies, None where it has none."""
    reader = _format_of(path)
    return reader.truth_path(path, reader.list_frames(path, config))


def read_poses(path: Path, config: CaptureConfig) -> Trajectory:
    """Poses of the colour camera from a TUM file, or those that a recorder stored in its folder.

    TrajectoryError where the folder has none.
    """
    if not path.is_dir():
        return read_tum(path)
    poses = _format_of(path).list_frames(path, config).poses
    if poses is None:
        raise TrajectoryError(
            f"expected poses that the recorder stored in {path}, found none; name a TUM file"
        )
    return poses


def read_truth(path: Path, config: CaptureConfig, camera_file: Path | None = None) -> Trajectory:
    """The true trajectory from a TUM file, or the one that comes with a capture folder.

    For scoring only. CaptureError where the folder has none.
    """
    if path.is_file():
        return read_tum(path)
    capture = open_capture(path, config, camera_file)
    if capture.truth is None:
        raise CaptureError(f"expected a true trajectory in {path}, found none")
    return _format_of(path).read_truth(capture.truth, capture.files, capture.camera)


def recognised(path: Path) -> CaptureFormat | None:
    """The format that a path is a capture folder of, None where it is none."""
    formats = FORMATS if path.is_dir() else ()
    return next((reader for reader in formats if reader.recognises(path)), None)


def require_units(config: CaptureConfig) -> None:
    """ConfigError where no camera can have the units that are set."""
    units = config.units_per_metre
    if 0 < units < LEAST:
        raise ConfigError(
            f"expected capture.units_per_metre to be 0 or at least {LEAST:g}, found {units:g}"
        )


def _format_of(path: Path) -> CaptureFormat:
    if (reader := recognised(path)) is not None:
        return reader
    if path.exists() and is_ros_bag(path):
        raise CaptureError(
            f"expected a capture folder at {path}, found a recording of ROS; make a folder of it"
            f" with 'vnav import {path} FOLDER', and name that"
        )
    if not path.is_dir():
        kind = "a file" if path.exists() else "nothing"
        raise CaptureError(f"expected a capture folder at {path}, found {kind}")
    known = "; ".join(f"{reader.LAYOUT} ({reader.NAME})" for reader in FORMATS)
    entries = sorted(entry.name for entry in path.iterdir())
    inside = ", ".join(entries[:5]) + (" ..." if len(entries) > 5 else "")
    raise CaptureError(
        f"expected a capture in {path}, that is one of: {known}; found"
        f" {inside or 'an empty folder'}"
    )


def _taken(
    root: Path, config: CaptureConfig, camera_file: Path | None, frames: FrameList
) -> tuple[Camera, FrameList]:
    """The camera of a capture, and its frames with the cameras that they have then."""
    require_units(config)
    units = config.units_per_metre
    own = root / "camera.toml"
    path = camera_file or (own if own.is_file() else None)
    if path is None and frames.camera is not None:
        if units > 0:
            frames = frames.with_cameras(lambda c: dataclasses.replace(c, units_per_metre=units))
        assert frames.camera is not None
        return frames.camera, frames
    path = path or _left_by_a_tool(root) or _preset(config)
    if path is None:
        raise no_camera(root, frames)
    camera = read_camera(path, has_depth=frames.has_depth, units_per_metre=units)
    return camera, frames.with_cameras(lambda _: camera)


def _left_by_a_tool(root: Path) -> Path | None:
    beside = files_beside(root)
    if len(beside) > 1:
        found = ", ".join(str(path.relative_to(root)) for path in beside)
        raise CameraError(
            f"expected one camera file in {root}, found {found}; name one with --camera FILE"
        )
    return beside[0] if beside else None


def _preset(config: CaptureConfig) -> Path | None:
    return preset_path(config.preset_camera) if config.preset_camera else None
