"""A folder of colour images beside one of depth images, as Open3D and RealSense tools write them.

Files belong together by the time in their names (1305031102.175304.png) or else by their number
(color_000017.jpg, depth_000017.png), or else by their order.
"""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vnav.config import CaptureConfig
from vnav.core.association import associate
from vnav.errors import CaptureError
from vnav.io.sources.frame_list import FrameList, ImageFile, paired
from vnav.io.sources.tum import read_truth as read_truth  # groundtruth.txt, as there
from vnav.io.sources.tum import truth_path as truth_path

NAME = "colour and depth folders"
LAYOUT = "color/ and depth/"

_COLOR, _DEPTH = ("color", "colour", "rgb"), ("depth", "depth_aligned")
_COLOR_SUFFIXES, _DEPTH_SUFFIXES = (".jpg", ".jpeg", ".png"), (".png",)
_AFTER_ANY_TIME_S = 1e11  # the year 5138
_TIME, _NUMBER = re.compile(r"\d+\.\d+$"), re.compile(r"\d+(?=\D*$)")


def recognises(root: Path) -> bool:
    """Whether the folder has one of the two folders."""
    return any((root / name).is_dir() for name in (*_COLOR, *_DEPTH))


def list_frames(root: Path, config: CaptureConfig) -> FrameList:
    """Colour and depth images that belong together by time, number or order."""
    colors = _images(root, _COLOR, _COLOR_SUFFIXES)
    depths = _images(root, _DEPTH, _DEPTH_SUFFIXES)
    color_s, depth_s = _stamps_s(colors, config), _stamps_s(depths, config)
    if color_s is not None and depth_s is not None:
        nearest_s = min(config.association_s, 0.5 / config.frame_rate_hz)
        matches = associate(color_s, depth_s, nearest_s)
        if len(matches):
            return paired(_timed(colors, color_s), _timed(depths, depth_s), matches)
    if len(colors) != len(depths):
        raise CaptureError(
            f"expected colour and depth images in {root} with the same times or numbers in their"
            f" names, or as many of both, found {len(colors)} and {len(depths)}"
        )
    rows = np.arange(len(colors))
    stamps_s = rows / config.frame_rate_hz
    return paired(_timed(colors, stamps_s), _timed(depths, stamps_s), np.stack([rows, rows], 1))


def _images(root: Path, names: tuple[str, ...], suffixes: tuple[str, ...]) -> list[Path]:
    folders = [root / name for name in names if (root / name).is_dir()]
    if len(folders) != 1:
        found = " and ".join(f"{folder.name}/" for folder in folders) or "none"
        wanted = ", ".join(f"{name}/" for name in names)
        raise CaptureError(f"expected one folder of {wanted} in {root}, found {found}")
    images = sorted(path for path in folders[0].iterdir() if path.suffix.lower() in suffixes)
    if not images:
        raise CaptureError(f"expected images ({', '.join(suffixes)}) in {folders[0]}, found none")
    return images


def _stamps_s(paths: Sequence[Path], config: CaptureConfig) -> NDArray[np.float64] | None:
    """Times from the files' names, or from their numbers; None where they have neither.

    Numbers too large for seconds since 1970 are times too: milli-, micro- or nanoseconds.
    """
    times = [_TIME.search(path.stem) for path in paths]
    numbers = [_NUMBER.search(path.stem) for path in paths]
    if not all(times) and not all(numbers):
        return None
    found = times if all(times) else numbers
    values = np.array([float(match[0]) for match in found if match])
    if not all(times) and values.min() < _AFTER_ANY_TIME_S:
        return values / config.frame_rate_hz
    while values.min() > _AFTER_ANY_TIME_S:
        values = values / 1000
    return values


def _timed(paths: Sequence[Path], stamps_s: NDArray[np.float64]) -> list[ImageFile]:
    return [ImageFile(float(s), path) for s, path in zip(stamps_s, paths, strict=True)]
