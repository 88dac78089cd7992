"""Depth without specks: single wrong pixels, as of interference, sunlight and flying pixels.

Compiled, since every frame that is read goes through it; imported only where depth is read.
"""

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Floats, Rows

MOST_PX = 4  # of a speck; larger patches may be things
UNLIKE_PER_M = 0.008  # in inverse depth from pixel to pixel: 4 sigma of two pixels of a Kinect
STEPS = 6000.0  # of inverse depth in 1/m, so that 16 bits reach to 0.18 m
MOST_STEPS, UNLIKE_STEPS = 32767, round(UNLIKE_PER_M * STEPS)
PATCH, SPECK = 1, 2

Steps = NDArray[np.int16]
Kinds = NDArray[np.uint8]


def without_specks(depth_m: Floats) -> Floats:
    """Depth (H, W) in metres, 0 where at most `MOST_PX` pixels are unlike the depth around them.

    A speck with no depth beside it stays: nothing contradicts it.
    """
    kinds = _kinds(_in_steps(depth_m))
    return _left_out(depth_m, kinds) if (kinds == SPECK).any() else depth_m


@compiled
def _in_steps(depth_m: Floats) -> Steps:
    """Inverse depth (H, W), 0 where there is none."""
    steps = np.zeros(depth_m.shape, np.int16)
    for v in range(depth_m.shape[0]):
        for u in range(depth_m.shape[1]):
            if depth_m[v, u] > 0:
                steps[v, u] = np.int16(min(np.float32(STEPS) / depth_m[v, u], MOST_STEPS))
    return steps


@compiled
def _kinds(steps: Steps) -> Kinds:
    """Whether pixels (H, W) are of a patch or of a speck, 0 without depth.

    A pixel is of the kind of those left of it and above, where it is like them.
    """
    kinds, found = np.zeros(steps.shape, np.uint8), np.empty((MOST_PX + 1, 2), np.int64)
    for v in range(steps.shape[0]):
        for u in range(steps.shape[1]):
            if steps[v, u] == 0 or kinds[v, u]:
                continue
            if u > 0 and _are_alike(steps[v, u], steps[v, u - 1]):
                kinds[v, u] = kinds[v, u - 1]
            elif v > 0 and _are_alike(steps[v, u], steps[v - 1, u]):
                kinds[v, u] = kinds[v - 1, u]
            else:
                count = _reached(found, steps, v, u)
                for k in range(count):
                    kinds[found[k, 0], found[k, 1]] = PATCH if count > MOST_PX else SPECK
    return kinds


@compiled
def _are_alike(step: int, other: int) -> bool:
    return bool(other > 0 and abs(np.int32(step) - np.int32(other)) <= UNLIKE_STEPS)


@compiled
def _reached(found: Rows, steps: Steps, v: int, u: int) -> int:
    """Put pixels that are one with a first into ``found`` (N, 2); how many, at most N."""
    found[0, 0], found[0, 1] = v, u
    count, begin = 1, 0
    while begin < count:
        v, u = found[begin]
        begin += 1
        for dv, du in ((0, 1), (1, 0), (0, -1), (-1, 0)):
            i, j = v + dv, u + du
            if not (0 <= i < steps.shape[0] and 0 <= j < steps.shape[1]):
                continue
            if not _are_alike(steps[v, u], steps[i, j]):
                continue
            is_new = True
            for k in range(count):
                is_new &= found[k, 0] != i or found[k, 1] != j
            if is_new:
                found[count, 0], found[count, 1] = i, j
                count += 1
                if count == len(found):
                    return count
    return count


@compiled
def _left_out(depth_m: Floats, kinds: Kinds) -> Floats:
    """Depth (H, W) without the pixels of specks that have a patch beside them."""
    left = depth_m.copy()
    height, width = kinds.shape
    for v in range(height):
        for u in range(width):
            if kinds[v, u] == SPECK:
                beside = kinds[max(v - 1, 0) : v + 2, max(u - 1, 0) : u + 2]
                if (beside == PATCH).any():
                    left[v, u] = 0
    return left
