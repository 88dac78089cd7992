"""The TUM RGB-D format: rgb.txt and depth.txt list images with their times.

A folder without depth.txt is a capture of colour alone.
"""

from pathlib import Path

import numpy as np

from vnav.config import CaptureConfig
from vnav.core.arrays import Array
from vnav.core.association import associate
from vnav.core.camera import Camera
from vnav.core.trajectory import Trajectory
from vnav.errors import CaptureError
from vnav.io.files import read_text
from vnav.io.formats.trajectories import read_tum
from vnav.io.sources.frame_list import FrameList, ImageFile, paired, unpaired

NAME = "TUM RGB-D"
LAYOUT = "rgb.txt and depth.txt"
SLOWEST_S = 10.0  # between images: what is farther apart is in another unit


def recognises(root: Path) -> bool:
    """Whether the folder has one of the lists."""
    return (root / "rgb.txt").is_file() or (root / "depth.txt").is_file()


def list_frames(root: Path, config: CaptureConfig) -> FrameList:
    """Colour and depth images whose times differ by less than ``association_s``, one to one."""
    colors = _read_list(root / "rgb.txt")
    if not (root / "depth.txt").exists():
        return unpaired(colors)
    depths = _read_list(root / "depth.txt")
    color_s, depth_s = (
        np.array([image.stamp_s for image in images]) for images in (colors, depths)
    )
    matches = associate(color_s, depth_s, config.association_s)
    if not len(matches):
        raise CaptureError(
            f"expected colour and depth images less than {config.association_s:g} s apart in"
            f" {root}, found none among {len(colors)} and {len(depths)}: {_apart(color_s, depth_s)}"
        )
    return paired(colors, depths, matches)


def _apart(color_s: Array, depth_s: Array) -> str:
    """How two lists of times (N,), (M,) that have none in common differ, and what to do."""
    if len(color_s) > 1 and (step_s := float(np.median(np.diff(np.sort(color_s))))) > SLOWEST_S:
        return (
            f"colour images are {step_s:g} s apart; write the times of both lists in seconds, if"
            " they are in milliseconds or less"
        )
    later_s = float(np.median(depth_s) - np.median(color_s))
    how, mend = ("later", "take that off") if later_s > 0 else ("earlier", "add that to")
    return (
        f"depth is {abs(later_s):.3f} s {how} in the median; if that is between two clocks, {mend}"
        " the times of depth.txt; if frames are that slow, raise the limit with --set"
        " capture.association_s=..."
    )


def truth_path(root: Path, frames: FrameList) -> Path | None:
    """The capture's groundtruth.txt, None where there is none."""
    path = root / "groundtruth.txt"
    return path if path.is_file() else None


def read_truth(path: Path, frames: FrameList, camera: Camera) -> Trajectory:
    """The true trajectory of the colour camera."""
    return read_tum(path)


def _read_list(path: Path) -> list[ImageFile]:
    try:
        lines = read_text(path).splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise CaptureError(
            f"expected the list of images {path}, found: {error}; a TUM folder has rgb.txt and"
            " depth.txt with lines 'time file'"
        ) from error
    rows = [(number, line.strip()) for number, line in enumerate(lines, 1)]
    images = [
        _image_file(path, number, line)
        for number, line in rows
        if line and not line.startswith("#")
    ]
    if not images:
        raise CaptureError(f"expected lines 'time file' in {path}, found none")
    times = len({image.stamp_s for image in images})
    if len(images) > 2 * times:
        raise CaptureError(
            f"expected a time for each image in {path}, found {'one' if times == 1 else times} for"
            f" {len(images)}; write seconds with all their digits"
        )
    return images


def _image_file(path: Path, number: int, line: str) -> ImageFile:
    stamp, _, name = line.replace(",", " ").replace("\t", " ").partition(" ")
    try:
        image = ImageFile(float(stamp), path.parent / name.strip())
    except ValueError:
        image = ImageFile(np.nan, path.parent)
    if not np.isfinite(image.stamp_s) or not name.strip():
        raise CaptureError(f"expected 'time file' in {path}, line {number}, found '{line}'")
    return image
