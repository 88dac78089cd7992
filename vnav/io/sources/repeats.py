"""Images that come twice: a camera that is slower than the other, or a recording that stalled."""

import filecmp
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise

from vnav.io.sources.capture import Capture, FileBacked
from vnav.io.sources.frame_list import FramePair, ImageFile

MANY = 0.1  # share of the frames: one camera is slower, and did not only slip now and then


@dataclass(frozen=True)
class Repeats:
    """How many frames have only the colour image of the frame before, only its depth, or both."""

    color: int = 0
    depth: int = 0
    both: int = 0


def repeats(pairs: Sequence[FramePair]) -> Repeats:
    """What comes twice, by the bytes of files; of videos and single files nothing is known."""
    found = Counter(
        (_are_same(before.color, pair.color), _are_same(before.depth, pair.depth))
        for before, pair in pairwise(pairs)
        if before.depth and pair.depth
    )
    return Repeats(found[True, False], found[False, True], found[True, True])


def has_slow_camera(capture: Capture) -> bool:
    """Whether many frames have an image of the frame before, so that colour and depth differ."""
    if not isinstance(capture, FileBacked):
        return False
    found = repeats(capture.files.pairs)
    return found.color + found.depth > MANY * len(capture)


def _are_same(a: ImageFile, b: ImageFile) -> bool:
    if a.video_frame is not None or b.video_frame is not None:
        return False
    with suppress(OSError):
        return filecmp.cmp(a.path, b.path, shallow=False)
    return False
