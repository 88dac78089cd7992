"""Motions from one frame to the next that no camera makes: there a track has lost its way."""

import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array
from vnav.core.mapping import FrameTable
from vnav.core.se3 import deviation, inverse

MOST = 7.0, 5.0  # rad/s, m/s: of a camera that is carried, or shaken
OTHERS = 0.95  # share of a recording's motions that are slower than its fast ones
TIMES = 3.0  # faster than these: where stamps are wrong, all motions are too fast


def jumps(frames: FrameTable, T_world_camera: Array) -> list[tuple[int, int]]:
    """Rows of frames of one capture that follow each other faster than a camera moves.

    ``T_world_camera`` (N, 4, 4) of all frames, NaN where unknown. Motions count that are too fast
    by themselves, and beside the other motions of their recording. Two frames whose stamps lie
    nearer to each other than most are taken to be as far apart as most.
    """
    posed = np.flatnonzero(np.isfinite(T_world_camera[:, 0, 0]))
    found: list[tuple[int, int]] = []
    for capture in np.unique(frames.capture[posed]):
        rows = posed[frames.capture[posed] == capture]
        i, j = rows[:-1], rows[1:]
        gap_s = np.diff(frames.stamp_s[rows])
        usual_s = np.median(gap_s) if len(gap_s) else 0.0
        if usual_s > 0:
            motions = inverse(T_world_camera[i]) @ T_world_camera[j]
            too_fast = _too_fast(motions, np.maximum(gap_s, usual_s))
            found += zip(i[too_fast].tolist(), j[too_fast].tolist(), strict=True)
    return found


def _too_fast(motions: Array, gap_s: Array) -> NDArray[np.bool_]:
    """Which motions (M, 4, 4) are, that take so many seconds (M,)."""
    size = np.linalg.norm(deviation(motions).reshape(-1, 2, 3), axis=2)
    speeds = size / gap_s[:, None]
    limits = np.maximum(MOST, TIMES * np.quantile(speeds, OTHERS, axis=0))
    return np.asarray((speeds > limits).any(1))
