"""Blocks that move, made regions: opened, large, and grown over the body they belong to: 003 S34.

What moves is connected, and so is its surface. A block that moves has the time to the frame in
which its surface is seen to move, in seconds; one that does not has infinity.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Floats
from vnav.masking.free_space import Votes
from vnav.masking.view import AROUND, Blocks, PosedView

REACH_M = 1.0  # that a region grows by, along the surface
LEAST_SHARE = 0.006  # of the image, that a body has: regions that are smaller may be noise
WHOLE = 1 / 3  # of a surface: where so much moves, all of it does
MAX_SAME = 5  # views that see a surface where it is, for it to be part of what moves
EDGE = 2  # blocks without depth beside a region that are its own: the sensor has none at edges
MARGIN, UNKNOWN = 0.1, 0.05  # of the image's width, at a side; share of a row that has depth there
NEAR_M = 0.8  # what is nearer may have no depth: a sensor's range begins there or before
BORDER = 0.5  # of a region without depth: where so much is near and moves, the region is too near


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


def bodies(regions: Blocks) -> Blocks:
    """The connected regions that are no noise: a frame with none of these has no mask."""
    return large(regions, LEAST_SHARE * regions.size)


def may_hold_bodies(coarse: Blocks) -> bool:
    """Whether opened regions may have a body, where only each second row and column was asked.

    Such a region is made of squares of three by three blocks. Each square has a block that was
    asked, and lies within two blocks of that.
    """
    reached = widened(widened(coarse)) if coarse.any() else coarse
    return bool(reached.sum() >= LEAST_SHARE * coarse.size and bodies(reached).any())


def beside(regions: Blocks, others: Blocks) -> Blocks:
    """Of other connected regions those that touch the given ones."""
    _, labels = cv2.connectedComponents(others.astype(np.uint8), connectivity=4)
    touched = np.unique(labels[widened(regions)])
    return np.asarray(np.isin(labels, touched[touched > 0]))


def grown(moved_s: Floats, votes: Votes, view: PosedView) -> Floats:
    """Blocks (h, w) that move, with the rest of the body that they are of, and its edges.

    A surface that no view sees through is of no body that moves: floor or wall, beside a heel that
    a mask has covered. Nor is a block that many views have seen where it is, and none has seen
    through: floor that is one surface with what stands on it.
    """
    stays = (votes.same > MAX_SAME) & (votes.free == 0)
    grows = bodies(np.isfinite(moved_s))
    block_rad = 1 / view.frame.intrinsics.fx
    is_body = np.isin(view.surfaces, view.surfaces[votes.seen_through])
    number = np.where((~stays & is_body) | grows, view.surfaces, np.int32(0))
    body = _flooded(grows, number, view.frame.inverse_depth, block_rad)
    return completed(joined(moved_s, body, view.surfaces), view, stays)


def completed(moved_s: Floats, view: PosedView, stays: Blocks) -> Floats:
    """Blocks (h, w) that move, with surfaces of which a third does, and what has no depth.

    That is at the edges of what moves, and where it is too near for the sensor. Of a surface those
    blocks are left out that are known to stay where they are.
    """
    number = view.surfaces
    moving = np.isfinite(moved_s)
    sizes, found = np.bincount(number.flat), np.bincount(number.flat, moving.flat)
    whole = (found >= WHOLE * sizes) & (found >= LEAST_SHARE * number.size)
    whole[0] = False
    moving |= whole[number] & ~stays
    for _ in range(EDGE):
        moving |= widened(moving) & (number == 0)
    return joined(moved_s, _into_margins(moving | _too_near(moving, view), number > 0), number)


def _into_margins(moving: Blocks, known: Blocks) -> Blocks:
    """With what moves reaching on to the edges of the image, where the sensor's view ends before.

    Depth that is registered to colour leaves a margin at some sides.
    """
    for turns in range(4):
        of_side, depth = np.rot90(moving, turns), np.rot90(known, turns)
        begin = int((depth.mean(1) > UNKNOWN).argmax())
        if 0 < begin <= MARGIN * known.shape[1]:
            of_side[:begin] |= of_side[begin]
    return moving


def _too_near(moving: Blocks, view: PosedView) -> Blocks:
    """Regions (h, w) without depth, most of whose border is near and moves."""
    is_near = moving & (view.frame.inverse_depth > 1 / NEAR_M)
    if not is_near.any():
        return is_near
    unknown = opened(view.surfaces == 0)
    count, labels = cv2.connectedComponents(unknown.astype(np.uint8), connectivity=4)
    around = cv2.dilate(labels.astype(np.float32), AROUND).astype(np.intp)
    border = (view.surfaces > 0) & (around > 0)
    length = np.bincount(around[border], minlength=count)
    near = np.bincount(around[border & is_near], minlength=count)
    is_too_near = (near > 0) & (near >= BORDER * length)
    return np.asarray(is_too_near[labels])


def joined(moved_s: Floats, blocks: Blocks, number: NDArray[np.int32]) -> Floats:
    """With more blocks, which move when their surface does; at once where they are of none."""
    soonest = np.full(number.max() + 1, np.inf, np.float32)
    np.minimum.at(soonest, number.ravel(), moved_s.ravel())
    soonest[0] = 0
    return np.where(blocks & np.isinf(moved_s), soonest[number], moved_s)


def widened(blocks: Blocks) -> Blocks:
    """Blocks (h, w) with those around them."""
    return np.asarray(cv2.dilate(blocks.astype(np.uint8), AROUND) > 0)


@compiled
def _flooded(
    regions: Blocks, number: NDArray[np.int32], inverse_depth: Floats, block_rad: float
) -> Blocks:
    """Breadth first from the regions, over their surfaces, `REACH_M` far; number 0 is of none."""
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
            surface = number[row, column]
            if surface == 0 or surface != number[v, u]:
                continue
            length_m = way_m[v, u] + block_rad / inverse_depth[row, column]
            if length_m < REACH_M:
                result[row, column], way_m[row, column] = True, length_m
                queue[end, 0], queue[end, 1] = row, column
                end += 1
    return result
