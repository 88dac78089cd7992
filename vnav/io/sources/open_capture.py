"""Folders of image files as captures: the format is recognised, the camera found.

A new format is one module like `vnav.io.sources.tum` and its name in `FORMATS`.
"""

import dataclasses
from pathlib import Path
from typing import Protocol

from vnav.config import CaptureConfig, preset_cameras
from vnav.core.camera import LEAST, Camera
from vnav.core.trajectory import Trajectory
from vnav.errors import CameraError, CaptureError, ConfigError
from vnav.io.formats.camera_file import preset_path, read_camera
from vnav.io.formats.trajectories import read_tum
from vnav.io.sources import color_depth, seven_scenes, tum
from vnav.io.sources.folder_capture import FolderCapture
from vnav.io.sources.frame_list import FrameList


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


FORMATS: tuple[CaptureFormat, ...] = (tum, seven_scenes, color_depth)


def open_capture(
    path: Path, config: CaptureConfig, camera_file: Path | None = None
) -> FolderCapture:
    """The capture in a folder, read by the format that recognises it.

    Its camera comes from ``camera_file``, else camera.toml in the folder, else the preset that
    ``config.preset_camera`` names; ``config.units_per_metre`` above 0 replaces the camera's.
    CaptureError where there is no capture, CameraError where there is no camera.
    """
    reader = _format_of(path)
    frames = reader.list_frames(path, config)
    camera = _camera(path, config, camera_file, frames.has_depth)
    return FolderCapture(path, camera, frames, reader.truth_path(path, frames))


def truth_of(path: Path, config: CaptureConfig) -> Path | None:
    """Where the true trajectory of a capture lies, None where it has none."""
    reader = _format_of(path)
    return reader.truth_path(path, reader.list_frames(path, config))


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


def _format_of(path: Path) -> CaptureFormat:
    if not path.is_dir():
        found = "a file" if path.exists() else "nothing"
        raise CaptureError(f"expected a capture folder at {path}, found {found}")
    for candidate in FORMATS:
        if candidate.recognises(path):
            return candidate
    known = "; ".join(f"{reader.LAYOUT} ({reader.NAME})" for reader in FORMATS)
    entries = sorted(entry.name for entry in path.iterdir())
    found = ", ".join(entries[:5]) + (" ..." if len(entries) > 5 else "")
    raise CaptureError(
        f"expected a capture in {path}, that is one of: {known}; found {found or 'an empty folder'}"
    )


def camera_path(path: Path, config: CaptureConfig, camera_file: Path | None = None) -> Path:
    """The camera.toml that is a capture's: see `open_capture`; CameraError where there is none."""
    beside = path / "camera.toml"
    if camera_file is not None or beside.is_file():
        return camera_file or beside
    if config.preset_camera:
        return preset_path(config.preset_camera)
    presets = ", ".join(preset_cameras())
    raise CameraError(
        f"expected a camera for {path}, found no camera.toml in it; write one, or name one with"
        f" --camera FILE, or a preset with --set capture.preset_camera=NAME ({presets})"
    )


def _camera(path: Path, config: CaptureConfig, camera_file: Path | None, has_depth: bool) -> Camera:
    camera = read_camera(camera_path(path, config, camera_file), has_depth=has_depth)
    if 0 < config.units_per_metre < LEAST:
        raise ConfigError(
            f"expected capture.units_per_metre to be 0 or at least {LEAST:g}, found"
            f" {config.units_per_metre:g}"
        )
    if config.units_per_metre > 0:
        camera = dataclasses.replace(camera, units_per_metre=config.units_per_metre)
    return camera
