"""With the colour of which frame depth belongs: pairs of two moments show here.

Depth that was taken earlier, or paired a line too far, meets the edges of another frame's colour
better than those of its own, while the camera moves.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from vnav.checking.depth_edges import depth_edges
from vnav.checking.depth_shift import WIDENED, EdgeProfiles, draws, profiles_across
from vnav.core.arrays import Array
from vnav.io.sources.capture import Capture

REACH = 5  # frames, to either side
PLACES = 24  # of the capture whose depth is held against colour, evenly
AGREEING = 0.99  # of the draws
LEAST_GAIN = 1.1  # over a frame's own colour: a camera that hardly moves sees all alike


@dataclass(frozen=True)
class DepthLag:
    """Depth belongs with the colour of so many ``frames`` before it, by ``time_s``; after: < 0."""

    frames: int
    time_s: float


def rows_to_compare(count: int) -> list[int]:
    """Frames of a capture of so many that have neighbours to either side."""
    if count <= 2 * REACH:
        return []
    rows = np.linspace(REACH, count - 1 - REACH, PLACES).round().astype(int)
    return [int(row) for row in np.unique(rows)]


def lagging_profiles(capture: Capture, row: int) -> list[EdgeProfiles]:
    """Of one frame's depth on the colour of the frames from `REACH` before to `REACH` after it.

    None where these are not all of one size.
    """
    frames = [capture.read(row + k) for k in range(-REACH, REACH + 1)]
    if len({frame.intrinsics.size for frame in frames}) > 1:
        return []
    edges = depth_edges(frames[REACH].depth_m)
    return [profiles_across(edges, frame.color) for frame in frames]


def depth_lag(profiles: Sequence[Sequence[EdgeProfiles]], step_s: float) -> DepthLag | None:
    """The lag that nearly all draws of frames agree on, to a frame; None where it may be 0.

    ``profiles``: of some frames, as of `lagging_profiles`, those of the first one's size count;
    ``step_s``: from one frame to the next.
    """
    profiles = [each for each in profiles if each[0].width == profiles[0][0].width]
    if not profiles:
        return None
    sums = np.array([[each.sums for each in frame] for frame in profiles])
    counts = np.array([[each.count for each in frame] for frame in profiles], float)
    reach = 2 * round(WIDENED * profiles[0][0].width / 2) + 1
    drawn = draws(len(profiles))
    best = np.array([_best(_meeting(sums[rows], counts[rows], reach)) for rows in drawn])
    lag = int(np.bincount(best).argmax())
    agree = (best != REACH) & (np.abs(best - lag) <= 1)
    if agree.mean() < AGREEING:
        return None
    return DepthLag(REACH - lag, (REACH - lag) * step_s)


def _best(meeting: Array) -> int:
    """The lag with the most, the frame's own where none has clearly more."""
    most = int(meeting.argmax())
    return most if meeting[most] > LEAST_GAIN * meeting[REACH] else REACH


def _meeting(sums: Array, counts: Array, reach: int) -> Array:
    """How much of colour's steps lies at one place beside the edges of depth, by lag (2 R + 1,)."""
    profiles = sums.sum(0) / np.maximum(counts.sum(0), 1)[..., None]
    rows = profiles.reshape(-1, profiles.shape[-1])
    near = cv2.blur(rows, (reach, 1), borderType=cv2.BORDER_REPLICATE).reshape(profiles.shape)
    return np.asarray(near.max(-1).sum(-1))
