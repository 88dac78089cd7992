"""Frames reduced to blocks; compiled, since every frame is."""

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Floats
from vnav.core.frame import Frame
from vnav.core.reduced_frame import BLOCK_PX, ReducedFrame, pixels_of_blocks, reduced_camera

FILLED = 0.5  # share of a block's pixels that must have depth
MAX_JUMP = 0.05  # relative spread of inverse depth within a block; more is a depth edge
GREY_WEIGHTS = 0.299, 0.587, 0.114  # of red, green and blue


def reduced(frame: Frame, block_px: int = BLOCK_PX) -> ReducedFrame:
    """A frame in blocks of ``block_px`` pixels; what is left over at the right and below is cut."""
    grey = _grey(frame.color, block_px, np.array(GREY_WEIGHTS, np.float32))
    inverse_depth = _inverse_depth(frame.depth_m, block_px)
    camera = reduced_camera(frame.intrinsics, block_px)
    whole = ReducedFrame(frame.stamp_s, grey, inverse_depth, camera)
    if frame.hidden is None:
        return whole
    return whole.without(pixels_of_blocks(frame.hidden, block_px).max(0) > 0)


@compiled
def _grey(color: NDArray[np.uint8], block_px: int, weights: Floats) -> Floats:
    """Mean brightness of blocks (h, w) of a colour image (H, W, 3)."""
    height, width = color.shape[0] // block_px, color.shape[1] // block_px
    grey, sums = np.zeros((height, width), np.float32), np.empty(3 * width, np.int32)
    pixels = np.float32(block_px * block_px)
    for i in range(height):
        sums[:] = 0
        for v in range(i * block_px, (i + 1) * block_px):
            for u in range(width * block_px):
                for k in range(3):
                    sums[u // block_px * 3 + k] += color[v, u, k]
        for j in range(width):
            for k in range(3):
                grey[i, j] += weights[k] * (np.float32(sums[3 * j + k]) / pixels)
    return grey


@compiled
def _inverse_depth(depth_m: Floats, block_px: int) -> Floats:
    """Of blocks (h, w) of depth (H, W): the mean where most have depth of one surface, else 0."""
    height, width = depth_m.shape[0] // block_px, depth_m.shape[1] // block_px
    inverse_depth = np.zeros((height, width), np.float32)
    for i in range(height):
        for j in range(width):
            total, least, most, count = np.float32(0), np.float32(np.inf), np.float32(0), 0
            for v in range(i * block_px, (i + 1) * block_px):
                for u in range(j * block_px, (j + 1) * block_px):
                    if depth_m[v, u] > 0:
                        inverse = np.float32(1) / depth_m[v, u]
                        total, count = total + inverse, count + 1
                        least, most = min(least, inverse), max(most, inverse)
            mean = total / np.float32(max(count, 1))
            is_one_surface = most - least <= np.float32(MAX_JUMP) * mean
            if is_one_surface and count >= FILLED * block_px * block_px:
                inverse_depth[i, j] = mean
    return inverse_depth
