"""Images that come twice: a camera that is slower than the other, or a recording that stalled."""

import filecmp
from collections import defaultdict
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise

from vnav.errors import CaptureError
from vnav.io.formats.images import read_depth
from vnav.io.sources.capture import Capture, FileBacked
from vnav.io.sources.frame_list import FramePair, ImageFile

MANY = 0.1  # share of the frames: one camera is slower, and did not only slip now and then
STALE = "its {} image is that of the frame before; record colour and depth at one rate"


@dataclass(frozen=True)
class Repeats:
    """Rows of the frames with only the colour image of the frame before, its depth, or both."""

    frames: int
    color: tuple[int, ...] = ()
    depth: tuple[int, ...] = ()
    both: tuple[int, ...] = ()

    @property
    def has_slow_camera(self) -> bool:
        """Whether colour and depth of many frames are not of one moment."""
        return len(self.color) + len(self.depth) > MANY * self.frames

    @property
    def has_stalled(self) -> bool:
        """Whether many frames are the one before once more."""
        return len(self.both) > MANY * self.frames


def repeats(pairs: Sequence[FramePair]) -> Repeats:
    """What comes twice, by the bytes of files; of videos and blank depth nothing is known."""
    rows = defaultdict(list)
    for row, (before, pair) in enumerate(pairwise(pairs), 1):
        if before.depth and pair.depth:
            color, depth = _are_same(before.color, pair.color), _are_same(before.depth, pair.depth)
            if not (depth and _is_blank(pair.depth)):
                rows[color, depth].append(row)
    kinds = (True, False), (False, True), (True, True)
    return Repeats(len(pairs), *(tuple(rows[kind]) for kind in kinds))


def stale_frames(capture: Capture) -> dict[int, str]:
    """Why colour and depth are not of one moment, by row of frame; {} where no camera is slow."""
    if not isinstance(capture, FileBacked):
        return {}
    found = repeats(capture.files.pairs)
    if not found.has_slow_camera:
        return {}
    kinds = ("colour", found.color), ("depth", found.depth)
    return {row: STALE.format(kind) for kind, rows in kinds for row in rows}


def _are_same(a: ImageFile, b: ImageFile) -> bool:
    if a.video_frame is not None or b.video_frame is not None:
        return False
    with suppress(OSError):
        return filecmp.cmp(a.path, b.path, shallow=False)
    return False


def _is_blank(depth: ImageFile) -> bool:
    with suppress(CaptureError):
        return not read_depth(depth.path).any()
    return False
