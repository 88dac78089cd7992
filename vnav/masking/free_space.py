"""How many views see through a surface that one view sees, and how many see it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core import se3
from vnav.core.arrays import Array, Floats
from vnav.masking.view import Blocks, PosedView

MIN_Z_M = 0.05  # nothing is seen nearer than this
SIGMAS = 4.0 * np.sqrt(2)  # of the difference of two depths, that are not noise
SAME, RUN, LONGEST_RUN = range(3)


@dataclass(frozen=True)
class Votes:
    """Of each block (h, w): how many views see its surface, and how many see through it.

    ``free_run``: most of these in a row, with none between them that sees the surface. Something
    that comes or goes is seen through by all before or after; an error of a pose is not.
    """

    same: NDArray[np.int32]
    free_run: NDArray[np.int32]


def count_votes(
    view: PosedView, others: Sequence[PosedView], sigma_per_m2: float, margin_m: float
) -> Votes:
    """Hold a view's surfaces against what others, in order of time, measured where they fall.

    A surface is seen through where a view has measured depth in a block and all about it, all
    farther by more than the noise and the margin: a misalignment of one block changes nothing.
    Where a view has no depth, where something hides the surface, and beyond the image it has no
    vote. Views have one camera; none give no votes.
    """
    counts = np.zeros((3, *view.frame.grey.shape), np.int32)
    K = view.frame.intrinsics
    camera = np.array([K.fx, K.fy, K.cx, K.cy])
    limits = np.array([SIGMAS * sigma_per_m2, margin_m])
    for other in others:
        T = se3.inverse(other.T_track_camera) @ view.T_track_camera
        seen = (other.nearest, other.farthest, other.clear)
        _add_votes(counts, view.frame.inverse_depth, *seen, T, camera, limits)
    return Votes(counts[SAME], counts[LONGEST_RUN])


@compiled
def _add_votes(
    counts: NDArray[np.int32],
    inverse_depth: Floats,
    nearest: Floats,
    farthest: Floats,
    clear: Blocks,
    T: Array,
    camera: Array,
    limits: Array,
) -> None:
    """Add one view's votes, in place; T takes points to it, and depths are inverse depths."""
    height, width = inverse_depth.shape
    fx, fy, cx, cy = camera
    for v in range(height):
        for u in range(width):
            w = inverse_depth[v, u]
            x, y = (u - cx) / fx, (v - cy) / fy
            z = T[2, 0] * x + T[2, 1] * y + T[2, 2] + T[2, 3] * w  # times w, as all three
            if w == 0 or z <= MIN_Z_M * w:
                continue
            column = fx * (T[0, 0] * x + T[0, 1] * y + T[0, 2] + T[0, 3] * w) / z + cx
            row = fy * (T[1, 0] * x + T[1, 1] * y + T[1, 2] + T[1, 3] * w) / z + cy
            if not (-0.5 <= column < width - 0.5 and -0.5 <= row < height - 0.5):
                continue
            i, j = int(row + 0.5), int(column + 0.5)
            if nearest[i, j] == 0:
                continue
            expected = w / z
            tolerance = limits[0] + limits[1] * expected * nearest[i, j]
            if expected - nearest[i, j] > tolerance:
                run = counts[RUN, v, u] + clear[i, j]
                counts[RUN, v, u] = run
                counts[LONGEST_RUN, v, u] = max(counts[LONGEST_RUN, v, u], run)
            elif expected > farthest[i, j] - tolerance:
                counts[SAME, v, u] += 1
                counts[RUN, v, u] = 0
