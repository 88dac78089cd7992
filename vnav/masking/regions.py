"""Blocks that move, made regions: opened, large, and grown over the body they belong to: 003 S34.

What moves is connected, and so is its depth: a step between blocks of less than 5 cm.
"""

import cv2
import numpy as np

from vnav.compiled import compiled
from vnav.core.arrays import Floats
from vnav.core.reduced_frame import ReducedFrame
from vnav.masking.free_space import Votes
from vnav.masking.view import AROUND, Blocks

STEP_M = 0.05  # between neighbours on one body
REACH_M = 1.0  # that a region grows by, along the surface
LEAST_SHARE = 0.006  # of the image, that a region has which grows: smaller ones may be noise
MAX_SAME = 5  # views that see a surface where it is, for it to be part of what moves
EDGE = 2  # blocks without depth beside a region that are its own: the sensor has none at edges


def opened(blocks: Blocks) -> Blocks:
    """Without what is narrower than three blocks."""
    return np.asarray(cv2.morphologyEx(blocks.astype(np.uint8), cv2.MORPH_OPEN, AROUND) > 0)


def large(blocks: Blocks, least: float) -> Blocks:
    """The connected regions of at least so many blocks."""
    _, labels, statistics, _ = cv2.connectedComponentsWithStats(
        blocks.astype(np.uint8), connectivity=4
    )
    kept = statistics[:, cv2.CC_STAT_AREA] >= least
    kept[0] = False
    return np.asarray(kept[labels])


def beside(regions: Blocks, others: Blocks) -> Blocks:
    """Of other connected regions those that touch the given ones."""
    _, labels = cv2.connectedComponents(others.astype(np.uint8), connectivity=4)
    touched = np.unique(labels[_widened(regions)])
    return np.asarray(np.isin(labels, touched[touched > 0]))


def grown(regions: Blocks, votes: Votes, frame: ReducedFrame) -> Blocks:
    """Regions with the rest of the body that they are of, and its edges, which have no depth.

    A block that many views have seen where it is and none has seen through is of no body that
    moves: floor or wall.
    """
    may_move = (votes.same <= MAX_SAME) | (votes.free > 0)
    bodies = large(regions, LEAST_SHARE * regions.size)
    block_rad = 1 / frame.intrinsics.fx
    result = regions | _flooded(bodies, may_move, frame.inverse_depth, block_rad)
    for _ in range(EDGE):
        result |= _widened(result) & (frame.inverse_depth == 0)
    return result


def _widened(blocks: Blocks) -> Blocks:
    return np.asarray(cv2.dilate(blocks.astype(np.uint8), AROUND) > 0)


@compiled
def _flooded(regions: Blocks, may_move: Blocks, inverse_depth: Floats, block_rad: float) -> Blocks:
    """Breadth first from the regions, over depth without steps, `REACH_M` far."""
    height, width = regions.shape
    result = regions.copy()
    queue, way_m = np.empty((regions.size, 2), np.int64), np.zeros(regions.shape, np.float32)
    end = 0
    for v in range(height):
        for u in range(width):
            if regions[v, u]:
                queue[end, 0], queue[end, 1] = v, u
                end += 1
    begin = 0
    while begin < end:
        v, u = queue[begin]
        begin += 1
        for dv, du in ((0, 1), (1, 0), (0, -1), (-1, 0)):
            row, column = v + dv, u + du
            if not (0 <= row < height and 0 <= column < width) or result[row, column]:
                continue
            here, there = inverse_depth[v, u], inverse_depth[row, column]
            length_m = way_m[v, u] + block_rad / there
            joined = abs(here - there) < STEP_M * here * there
            if may_move[row, column] and joined and length_m < REACH_M:
                result[row, column], way_m[row, column] = True, length_m
                queue[end, 0], queue[end, 1] = row, column
                end += 1
    return result
