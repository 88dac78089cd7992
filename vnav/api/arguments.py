"""What callers may write for a path, a configuration, a camera or a photo, made definite."""

from collections.abc import Sequence
from math import isfinite, nan
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav import config
from vnav.config import CaptureConfig, Config
from vnav.core.camera import Camera, Intrinsics
from vnav.core.trajectory import Trajectory
from vnav.errors import MapError, PhotoError
from vnav.io.photos.photo_files import AUTO, PhotoCameraSource
from vnav.io.sources.capture import Capture
from vnav.io.sources.open_capture import open_capture, read_poses
from vnav.io.sources.record3d import is_recording, open_recording
from vnav.localisation.verdict.answer import PhotoAnswer

AnyPath = str | PathLike[str]
ConfigSource = Config | AnyPath | None  # None: the defaults
PhotoSource = AnyPath | NDArray[Any]  # pixels are checked when they are taken
PlaceSource = PhotoSource | PhotoAnswer | Sequence[float]  # x, y
CameraSource = Camera | Intrinsics | AnyPath | None
CaptureSource = Capture | AnyPath
TrajectorySource = Trajectory | AnyPath


def config_of(source: ConfigSource) -> Config:
    """A configuration as it is, of a preset's name or of a TOML file; the defaults for None."""
    return (
        source
        if isinstance(source, Config)
        else config.load(None if source is None else str(source))
    )


def capture_of(source: CaptureSource, settings: Config, camera: AnyPath | None) -> Capture:
    """A capture as it is, or the one at a path; ``camera``: a camera.toml, where it has none."""
    if not isinstance(source, str | PathLike):
        return source
    path, camera_file = Path(source), None if camera is None else Path(camera)
    opened = open_recording if is_recording(path) else open_capture
    return opened(path, settings.capture, camera_file)


def trajectory_of(source: TrajectorySource) -> Trajectory:
    """Poses as they are, those of a TUM file, or those that a recorder stored in its folder."""
    if isinstance(source, str | PathLike):
        return read_poses(Path(source), CaptureConfig())
    return source


def photo_of(source: PhotoSource) -> Path | NDArray[np.uint8]:
    """A photo's file, or its pixels; PhotoError where they are no RGB image."""
    if isinstance(source, str | PathLike):
        return Path(source)
    image = np.asarray(source)
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or not image.size:
        raise PhotoError(
            f"expected a photo of shape (H, W, 3) and type uint8, RGB, found {image.shape} and"
            f" {image.dtype}; convert it first"
        )
    return image


def xy_of(source: PlaceSource) -> tuple[float, float] | None:
    """X and y, None where a photo is given instead; MapError where it is neither."""
    if isinstance(source, str | PathLike | PhotoAnswer) or np.ndim(source) > 1:
        return None
    try:
        x, y = map(float, source)
    except (TypeError, ValueError):
        x = y = nan
    if not (isfinite(x) and isfinite(y)):
        raise MapError(f"expected x, y in metres of the map's world, found {source!r}")
    return x, y


def photo_camera_of(source: CameraSource) -> PhotoCameraSource:
    """The camera of photos: intrinsics, a camera.toml, "auto", or None."""
    if isinstance(source, Camera):
        return source.color
    if source is None or isinstance(source, Intrinsics) or source == AUTO:
        return source
    return Path(source)
