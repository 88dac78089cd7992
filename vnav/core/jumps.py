"""Motions from one frame to the next that no camera makes: there a track has lost its way."""

from collections.abc import Iterator
from itertools import compress

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vnav.core.arrays import Array
from vnav.core.mapping import FrameTable
from vnav.core.se3 import angle_and_distance, inverse

FASTEST = 7.0, 5.0  # rad/s, m/s: of a camera that is carried, or shaken
OTHERS = 0.95  # share of a recording's motions that are slower than its fast ones
TIMES_FASTER = 3.0  # faster than these: where stamps are wrong, all motions are too fast
RUSH = 1e-4  # times as likely is a motion that no camera makes
SHORT_S = 2.0  # what fills a view and walks along is gone after so long


def jumps(
    frames: FrameTable, T_world_camera: Array, part: NDArray[np.int32]
) -> list[tuple[int, int]]:
    """Rows of frames of one capture and part that follow each other faster than a camera moves.

    ``T_world_camera`` (N, 4, 4) of all frames, NaN where unknown, of each ``part`` (N,) by itself.
    Motions count that are too fast by themselves, and beside the other motions of their recording.
    Two frames whose stamps lie nearer to each other than most are taken to be as far apart as most.
    """
    found: list[tuple[int, int]] = []
    for rows in _tracks(frames, T_world_camera, part):
        i, j = rows[:-1], rows[1:]
        gap_s = np.diff(frames.stamp_s[rows])
        usual_s = np.median(gap_s) if len(gap_s) else 0.0
        if usual_s > 0:
            motions = inverse(T_world_camera[i]) @ T_world_camera[j]
            too_fast = _too_fast(motions, np.maximum(gap_s, usual_s))
            found += zip(i[too_fast].tolist(), j[too_fast].tolist(), strict=True)
    return found


def between_jumps(
    frames: FrameTable, T_world_camera: Array, part: NDArray[np.int32]
) -> NDArray[np.intp]:
    """Rows of frames that a track jumps to and away from soon; see `jumps`.

    A track falls into runs, from jump to jump. A run is short that lasts less than `SHORT_S`, and
    less than half of the longest.
    """
    starts = [row for _, row in jumps(frames, T_world_camera, part)]
    found: list[NDArray[np.intp]] = []
    for rows in _tracks(frames, T_world_camera, part) if starts else []:
        runs = np.split(rows, np.flatnonzero(np.isin(rows, starts)))
        took_s = np.array([np.ptp(frames.stamp_s[run]) for run in runs])
        found += compress(runs, took_s < min(SHORT_S, took_s.max() / 2))
    return np.sort(np.concatenate(found)) if found else np.zeros(0, np.intp)


def speeds(motions: Array, took_s: ArrayLike) -> Array:
    """Of motions (..., 4, 4) that take so many seconds (...): rad/s and m/s (..., 2)."""
    return np.asarray(angle_and_distance(motions) / np.asarray(took_s)[..., None])


def _tracks(
    frames: FrameTable, T_world_camera: Array, part: NDArray[np.int32]
) -> Iterator[NDArray[np.intp]]:
    """Rows of the frames with a pose, of each capture and part."""
    posed = np.flatnonzero(np.isfinite(T_world_camera[:, 0, 0]))
    of = np.stack([frames.capture, part])[:, posed]
    for track in np.unique(of, axis=1).T:
        yield posed[(track == of.T).all(1)]


def _too_fast(motions: Array, gap_s: Array) -> NDArray[np.bool_]:
    """Which motions (M, 4, 4) are, that take so many seconds (M,)."""
    each = speeds(motions, gap_s)
    limits = np.maximum(FASTEST, TIMES_FASTER * np.quantile(each, OTHERS, axis=0))
    return np.asarray((each > limits).any(1))
