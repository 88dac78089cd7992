"""Surfaces of one body with what moves: they touch it, and no view sees them stay when it has left.

003 S34 grows regions over continuous depth. A body has edges of its own, as between a shirt and
trousers, so that it has several surfaces. Floor and furniture touch it, too, but they stay.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Floats
from vnav.masking.free_space import FREE, SAME, noise_of, places_in, sees_through
from vnav.masking.view import Blocks, MaskedView, PosedView

REACH = 2  # blocks from one that touches another: at an edge there may be no depth
BEHIND = 2  # blocks behind that one: so far in, none of the other is about
STEP_M = 0.1  # between surfaces that touch, at most
LEAST = 3  # blocks that touch, that are seen through, that are seen in place
SAMPLES = 100  # blocks of a surface that are asked for, if it has so many


def with_attached(
    masked: MaskedView, others: Sequence[PosedView], sigma_per_m2: float, margin_m: float
) -> Floats:
    """Times (h, w) of a masked view, with the surfaces that are attached to what moves.

    A surface is attached where it touches blocks that move, a view sees through most of these, and
    no such view sees most of the surface in its place. It moves when the blocks do.
    """
    view, moved_s = masked.view, masked.moved_s
    count, moving = int(view.surfaces.max()) + 1, np.isfinite(moved_s)
    touching = _touching(moving, view.surfaces, view.frame.inverse_depth)
    is_touched = np.bincount(touching.surface, minlength=count) >= LEAST
    if not is_touched.any():
        return moved_s
    beside = _sampled(np.where(is_touched[view.surfaces] & ~moving, view.surfaces, 0))
    has_left, stays = np.zeros((2, count), bool)
    for other in others:
        noise = noise_of(view, other, sigma_per_m2, margin_m)
        left = touching.most(FREE, view, other, noise, margin_m, count)
        has_left |= left
        stays |= left & beside.most(SAME, view, other, noise, margin_m, count)
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
        self,
        answer: int,
        view: PosedView,
        other: PosedView,
        noise: float,
        margin_m: float,
        count: int,
    ) -> Blocks:
        """Of which surfaces (count,) another view sees most blocks in place, or sees through."""
        inverse_depth = np.zeros_like(view.frame.inverse_depth)
        inverse_depth.flat[self.blocks] = view.frame.inverse_depth.flat[self.blocks]
        places, expected = places_in(other, view, inverse_depth)
        near = other.about(1)
        seen = other.frame.inverse_depth, near.nearest, near.clear
        votes = np.zeros((2, count), np.int32)
        _tally(votes, self.blocks, self.surface, places, expected, *seen, noise, margin_m)
        return np.asarray((votes[answer] >= LEAST) & (votes[answer] > votes[1 - answer]))


def _sampled(number: NDArray[np.int32]) -> _Asked:
    """Some blocks of each surface (h, w), the same share of all its parts; number 0 is of none."""
    blocks = np.flatnonzero(number)
    blocks = blocks[np.argsort(number.flat[blocks], kind="stable")]
    surface = number.flat[blocks]
    rank = np.arange(len(blocks)) - np.searchsorted(surface, surface)
    chosen = rank % np.maximum(np.bincount(surface)[surface] // SAMPLES, 1) == 0
    return _Asked(blocks[chosen], surface[chosen])


def _touching(moving: Blocks, number: NDArray[np.int32], inverse_depth: Floats) -> _Asked:
    """Blocks that move, behind those that touch a surface that does not, by that surface."""
    places, still = np.arange(moving.size).reshape(moving.shape), np.where(moving, 0, number)
    found = [(np.zeros(0, np.intp), np.zeros(0, np.int32))]
    for step in np.array([(0, 1), (1, 0), (0, -1), (-1, 0)]):
        touches = moving & _beside(moving, -BEHIND * step) & (inverse_depth > 0)
        behind = _beside(places, -BEHIND * step)
        for k in range(1, REACH + 1):
            surface, w = _beside(still, k * step), _beside(inverse_depth, k * step)
            near = np.abs(w - inverse_depth) < STEP_M * w * inverse_depth
            touching = touches & (surface > 0) & near
            touches &= ~touching
            found.append((behind[touching], surface[touching]))
    return _Asked(*(np.concatenate(values) for values in zip(*found, strict=True)))


def _beside(values: NDArray[Any], step: NDArray[np.intp]) -> NDArray[Any]:
    """Of each block (h, w) the value of the one so many rows and columns on, 0 beyond the image."""
    edge, (height, width) = np.abs(step).max(), values.shape
    v, u = edge + step
    return np.pad(values, edge)[v : v + height, u : u + width]


@compiled
def _tally(
    votes: NDArray[np.int32],
    blocks: NDArray[np.intp],
    surface: NDArray[np.int32],
    places: NDArray[np.int32],
    expected: Floats,
    inverse_depth: Floats,
    nearest: Floats,
    clear: Blocks,
    noise: float,
    margin_m: float,
) -> None:
    """Add one view's votes for each surface (2, S), in place: it is there, or is seen through."""
    place_of, expected_of, depth_of = places.ravel(), expected.ravel(), inverse_depth.ravel()
    nearest_of, clear_at = nearest.ravel(), clear.ravel()
    for n in range(len(blocks)):
        w, place = expected_of[blocks[n]], place_of[blocks[n]]
        if place < 0 or nearest_of[place] == 0:
            continue
        if sees_through(w, nearest_of[place], noise, margin_m):
            votes[FREE, surface[n]] += clear_at[place]
        elif abs(w - depth_of[place]) < noise + margin_m * w * depth_of[place]:
            votes[SAME, surface[n]] += 1
