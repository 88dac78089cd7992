"""Surfaces of one body with what moves: they touch it, and no view sees them stay when it has left.

003 S34 grows regions over continuous depth. A body has edges of its own, as between a shirt and
trousers, so that it has several surfaces. Floor and furniture touch it, too, but they stay. Where a
body comes into view, all views that see a leg may see it in place: legs stand free, walls do not.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Floats
from vnav.masking.free_space import (
    FREE,
    SAME,
    SIGMAS,
    Projection,
    is_in_place,
    misfit,
    place_of,
    projection,
    sees_through,
)
from vnav.masking.view import Blocks, MaskedView, PosedView

REACH = 2  # blocks from one that touches another: at an edge there may be no depth
BEHIND = 2  # blocks behind that one: so far in, none of the other is about
STEP_M = 0.1  # between surfaces that touch, at most
LEAST = 3  # blocks that touch, that are seen through, that are seen in place
STANDS_FREE = 0.5  # share of its border
SAMPLES = 100  # blocks of a surface that are asked for, if it has so many


def with_attached(
    masked: MaskedView, others: Sequence[PosedView], sigma_per_m2: float, margin_m: float
) -> Floats:
    """Times (h, w) of a masked view, with the surfaces that are attached to what moves.

    A surface is attached where it touches blocks that move, a view sees through most of these, and
    no such view sees most of the surface in its place. For one that stands free, a view will do
    that sees through most of all that moves in one piece with these blocks, and not them in place.
    It moves when the blocks do. Views that do not fit well tell less, as in `count_votes`.
    """
    view, moved_s = masked.view, masked.moved_s
    count, moving = int(view.surfaces.max()) + 1, np.isfinite(moved_s)
    touching = _Asked(*_pairs(moving, view.surfaces, view.frame.inverse_depth))
    is_touched = np.bincount(touching.surface, minlength=count) >= LEAST
    if not is_touched.any():
        return moved_s
    beside = _sampled(np.where(is_touched[view.surfaces] & ~moving, view.surfaces, 0))
    bodies = _bodies(touching, moving, view, is_touched)

    def left_in(other: PosedView, noise: float) -> Blocks:
        asked = view, other, noise, margin_m, count
        of_body, of_touching = bodies.most(*asked), touching.most(*asked)
        return np.asarray(of_touching[FREE] | (of_body[FREE] & ~of_touching[SAME]))

    has_left, stays = np.zeros((2, count), bool)
    sigma = float(np.sqrt(2)) * sigma_per_m2
    for other in others:
        left = left_in(other, sigma)
        if left.any():
            off = max(sigma, misfit(view, other, sigma_per_m2, margin_m))
            left = left_in(other, off) if off > sigma else left
            has_left |= left
            stays |= left & beside.most(view, other, off, margin_m, count)[SAME]
    soonest_s = np.full(count, np.inf, np.float32)
    np.minimum.at(soonest_s, touching.surface, moved_s.ravel()[touching.blocks])
    soonest_s[~is_touched | ~has_left | stays] = np.inf
    return np.minimum(moved_s, soonest_s[view.surfaces])


@dataclass(frozen=True)
class _Asked:
    """Blocks (N,) of a view, by number, and of each the number (N,) of the surface it tells of."""

    blocks: NDArray[np.intp]
    surface: NDArray[np.int32]

    def most(
        self, view: PosedView, other: PosedView, sigma: float, margin_m: float, count: int
    ) -> Blocks:
        """Of which surfaces (2, count) another view sees most blocks in place, or sees through.

        By the margin, and by the standard deviation of the difference of two inverse depths.
        """
        near, noise = other.about(1), SIGMAS * sigma
        seen = other.frame.inverse_depth, near.nearest, near.clear
        votes = _votes(
            self.blocks,
            self.surface,
            count,
            view.frame.inverse_depth,
            *seen,
            projection(other, view),
            noise,
            margin_m,
        )
        return np.asarray((votes >= LEAST) & (votes > votes[::-1]))


def _bodies(touching: _Asked, moving: Blocks, view: PosedView, is_touched: Blocks) -> _Asked:
    """Some blocks of all that moves in one piece with what touches a surface that stands free."""
    border, before = _borders(moving, view.surfaces, view.frame.inverse_depth, len(is_touched))
    is_asked = is_touched & (before >= STANDS_FREE * border)
    piece = cv2.connectedComponents(moving.astype(np.uint8), connectivity=4)[1].astype(np.int32)
    pairs = np.unique(np.stack([touching.surface, piece.flat[touching.blocks]]), axis=1)
    surfaces, pieces = pairs[:, is_asked[pairs[0]]]
    sampled = _sampled(np.where(np.isin(piece, pieces), piece, 0))
    asked = [sampled.blocks[sampled.surface == number] for number in pieces]
    of_surface = np.repeat(surfaces, [len(blocks) for blocks in asked])
    return _Asked(np.concatenate([np.zeros(0, np.intp), *asked]), of_surface)


@compiled
def _borders(
    moving: Blocks, number: NDArray[np.int32], inverse_depth: Floats, count: int
) -> NDArray[np.int32]:
    """Length (2, S) of surfaces' borders, and of the part where the next moves or is far behind."""
    height, width = moving.shape
    moving_at, depth_of = moving.ravel(), inverse_depth.ravel()
    border = np.zeros((2, count), np.int32)
    for v in range(height):
        for u in range(width):
            if number[v, u] == 0 or moving[v, u]:
                continue
            for dv, du in ((0, 1), (1, 0), (0, -1), (-1, 0)):
                beyond = _beyond(v, u, dv, du, number)
                if beyond >= 0:
                    w, other = inverse_depth[v, u], depth_of[beyond]
                    border[0, number[v, u]] += 1
                    border[1, number[v, u]] += moving_at[beyond] or w - other > STEP_M * w * other
    return border


@compiled
def _beyond(v: int, u: int, dv: int, du: int, number: NDArray[np.int32]) -> int:
    """The block of the next surface in one direction, past an edge without depth; -1: none."""
    height, width = number.shape
    for k in range(1, REACH + 2):
        i, j = v + k * dv, u + k * du
        if not (0 <= i < height and 0 <= j < width) or number[i, j] == number[v, u]:
            return -1
        if number[i, j] > 0:
            return int(i * width + j)
    return -1


def _sampled(number: NDArray[np.int32]) -> _Asked:
    """Some blocks of each surface (h, w), the same share of all its parts; number 0 is of none."""
    blocks = np.flatnonzero(number)
    blocks = blocks[np.argsort(number.flat[blocks], kind="stable")]
    surface = number.flat[blocks]
    rank = np.arange(len(blocks)) - np.searchsorted(surface, surface)
    chosen = rank % np.maximum(np.bincount(surface)[surface] // SAMPLES, 1) == 0
    return _Asked(blocks[chosen], surface[chosen])


@compiled
def _pairs(
    moving: Blocks, number: NDArray[np.int32], inverse_depth: Floats
) -> tuple[NDArray[np.intp], NDArray[np.int32]]:
    """Blocks (N,) that move, and the surfaces (N,) that do not and touch one so far before them."""
    height, width = moving.shape
    blocks, surface = np.empty(4 * moving.size, np.intp), np.empty(4 * moving.size, np.int32)
    found = 0
    for v in range(height):
        for u in range(width):
            if not moving[v, u]:
                continue
            for dv, du in ((0, 1), (1, 0), (0, -1), (-1, 0)):
                i, j = v + BEHIND * dv, u + BEHIND * du
                if 0 <= i < height and 0 <= j < width and moving[i, j]:
                    touched = _touched(i, j, dv, du, moving, number, inverse_depth)
                    if touched > 0:
                        blocks[found], surface[found] = v * width + u, touched
                        found += 1
    return blocks[:found], surface[:found]


@compiled
def _touched(
    v: int,
    u: int,
    dv: int,
    du: int,
    moving: Blocks,
    number: NDArray[np.int32],
    inverse_depth: Floats,
) -> int:
    """The surface that a block touches in one direction, and that does not move; 0 is none."""
    height, width = moving.shape
    for k in range(1, REACH + 1):
        i, j = v + k * dv, u + k * du
        if 0 <= i < height and 0 <= j < width and not moving[i, j]:
            w, other = inverse_depth[v, u], inverse_depth[i, j]
            if abs(w - other) < STEP_M * w * other:
                return int(number[i, j])
    return 0


@compiled
def _votes(
    blocks: NDArray[np.intp],
    surface: NDArray[np.int32],
    count: int,
    inverse_depth: Floats,
    seen: Floats,
    nearest: Floats,
    clear: Blocks,
    to_other: Projection,
    noise: float,
    margin_m: float,
) -> NDArray[np.int32]:
    """Of each surface (2, S), how many blocks another view sees in place, and sees through."""
    height, width = inverse_depth.shape
    depth_of, nearest_of, clear_at = seen.ravel(), nearest.ravel(), clear.ravel()
    votes = np.zeros((2, count), np.int32)
    for n in range(len(blocks)):
        v, u = blocks[n] // width, blocks[n] % width
        place, w = place_of(v, u, inverse_depth[v, u], to_other, height, width)
        if place < 0 or nearest_of[place] == 0:
            continue
        if sees_through(w, nearest_of[place], noise, margin_m):
            votes[FREE, surface[n]] += clear_at[place]
        elif is_in_place(w, depth_of[place], noise, margin_m):
            votes[SAME, surface[n]] += 1
    return votes
