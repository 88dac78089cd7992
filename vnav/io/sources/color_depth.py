"""A folder of colour images beside one of depth images, as Open3D and RealSense tools write them.

Files belong together by the time in their names (1305031102.175304.png, 20261130_120059_800.png) or
else by their number (color_000017.jpg, depth_000017.png), or else by their order.
"""

import re
from collections.abc import Sequence
from datetime import UTC, datetime
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
_DATE = re.compile(
    r"(?<!\d)((?:19|20)\d\d)\D?(\d\d)\D?(\d\d)\D?(\d\d)\D?(\d\d)\D?(\d\d)"
    r"(?:\.(\d{1,9})|\D?(\d{3}|\d{6}|\d{9}))?$"
)
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

    Numbers too large for seconds since 1970 are times too: milli-, micro- or nanoseconds. What two
    files have in common tells no frames apart.
    """
    stamps_s = _dates_s(paths)
    if stamps_s is None:
        stamps_s = _numbers_s(paths, config)
    is_of_one = stamps_s is not None and len(np.unique(stamps_s)) == len(paths)
    return stamps_s if is_of_one else None


def _dates_s(paths: Sequence[Path]) -> NDArray[np.float64] | None:
    """Seconds since 1970 of dates with the time of day, which is taken for UTC."""
    found = [_DATE.search(path.stem) for path in paths]
    try:
        return np.array([_date_s(match) for match in found if match]) if all(found) else None
    except ValueError:  # a thirteenth month, or hour 25
        return None


def _date_s(match: re.Match[str]) -> float:
    year, month, day, hour, minute, second = map(int, match.groups()[:6])
    whole_s = datetime(year, month, day, hour, minute, second, tzinfo=UTC).timestamp()
    return whole_s + float(f"0.{match[7] or match[8] or 0}")


def _numbers_s(paths: Sequence[Path], config: CaptureConfig) -> NDArray[np.float64] | None:
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
