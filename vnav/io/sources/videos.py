"""A colour video beside one of depth: color.mp4 and depth.mkv, frame by frame.

Depth keeps its 16 bits in FFV1 alone, as ffmpeg writes it with ``-c:v ffv1 -pix_fmt gray16le``.
"""

from pathlib import Path

from vnav.config import CaptureConfig
from vnav.errors import CaptureError
from vnav.io.formats.video import Video, frame_count, frame_rate_hz
from vnav.io.sources.frame_list import FrameList, FramePair, ImageFile
from vnav.io.sources.tum import read_truth as read_truth  # groundtruth.txt, as there
from vnav.io.sources.tum import truth_path as truth_path

NAME = "videos"
LAYOUT = "color.mp4 and depth.mkv"

_COLOR, _DEPTH = ("color", "colour", "rgb"), ("depth", "depth_aligned")
_SUFFIXES = (".mkv", ".mp4", ".mov", ".avi", ".webm")
_SAME_RATE = 0.01  # share by which two rates may differ, as 30 and 29.97 do


def recognises(root: Path) -> bool:
    """Whether the folder has a video of depth, and one of colour."""
    return bool(_named(root, _DEPTH) and _named(root, _COLOR))


def list_frames(root: Path, config: CaptureConfig) -> FrameList:
    """Frames of both videos with the same number; what one has more is dropped.

    They are evenly apart at the videos' rate. CaptureError where the rates differ, or depth has no
    16 bits.
    """
    color, depth = _only(root, _COLOR), _only(root, _DEPTH)
    rate_hz, depth_hz = (frame_rate_hz(path) or config.frame_rate_hz for path in (color, depth))
    if abs(rate_hz - depth_hz) > _SAME_RATE * rate_hz:
        raise CaptureError(
            f"expected two videos at one rate in {root}, found {rate_hz:g} frames a second in"
            f" {color.name} and {depth_hz:g} in {depth.name}; write both at the same"
        )
    Video(depth).read_depth(0)
    colors, depths = (
        tuple(ImageFile(k / rate_hz, path, k) for k in range(frame_count(path)))
        for path in (color, depth)
    )
    count = min(len(colors), len(depths))
    pairs = tuple(map(FramePair, colors[:count], depths[:count]))
    return FrameList(pairs, colors[count:], depths[count:])


def _only(root: Path, names: tuple[str, ...]) -> Path:
    """The video of one of these names; CaptureError where there are several."""
    found = _named(root, names)
    if len(found) > 1:
        several = " and ".join(path.name for path in found)
        raise CaptureError(f"expected one video {names[0]} in {root}, found {several}")
    return found[0]


def _named(root: Path, names: tuple[str, ...]) -> list[Path]:
    files = (path for path in sorted(root.iterdir()) if path.suffix.lower() in _SUFFIXES)
    return [path for path in files if path.stem.lower() in names and path.is_file()]
