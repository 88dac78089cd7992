"""The camera.toml proposed for a capture that has none: sizes as measured, the rest guessed."""

from collections.abc import Sequence
from pathlib import Path

from vnav.config import preset_cameras
from vnav.core.camera import Camera, registered_camera
from vnav.errors import CameraError
from vnav.io.formats.camera_file import GUESS, MILLIMETRES, camera_text
from vnav.io.formats.images import first_size
from vnav.io.formats.video import video_size
from vnav.io.photos.photo_files import estimated_camera
from vnav.io.sources.frame_list import FrameList, ImageFile

_REMARKS = {
    "width": "of the first image",
    "height": "of the first image",
    "fx": f"{GUESS} by what vnav calibrate or the sensor's software tells",
    "fy": GUESS,
    "cx": GUESS,
    "cy": GUESS,
    "units_per_metre": f"{GUESS}; 1000 for millimetres, 5000 for TUM RGB-D",
    "T_color_depth": f"{GUESS}; depth camera to colour camera, in metres",
}


def no_camera(root: Path, frames: FrameList) -> CameraError:
    """The error that a capture has no camera; its note is a camera.toml to correct and save."""
    error = CameraError(
        f"expected a camera for {root}, found no camera.toml in it, nor a camera file of another"
        f" tool; save the proposed lines as {root / 'camera.toml'} and replace what is guessed, or"
        " name a file with --camera FILE, or a preset with --set capture.preset_camera=NAME"
        f" ({', '.join(preset_cameras())})"
    )
    color = _size([pair.color for pair in frames.pairs])
    depth = _size([pair.depth for pair in frames.pairs if pair.depth])
    if color is not None:
        error.add_note(camera_text(_guessed(color, depth or color), _REMARKS))
    return error


def _size(images: Sequence[ImageFile]) -> tuple[int, int] | None:
    """Width and height of the first whole image, or of a video's."""
    if images and images[0].video_frame is not None:
        return video_size(images[0].path)
    return first_size(image.path for image in images)


def _guessed(color: tuple[int, int], depth: tuple[int, int]) -> Camera:
    """Depth of colour's size is taken to be registered; of another, to look the same way."""
    return registered_camera(estimated_camera(color).intrinsics, MILLIMETRES, depth)
