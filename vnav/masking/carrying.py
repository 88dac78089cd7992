"""What moves in one view, found in another: surfaces that both see in the same place.

Who stands still is where he was. Who walks is mostly there, too, in the frame beside.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Floats
from vnav.masking.free_space import SIGMAS, Projection, is_in_place, place_of, projection
from vnav.masking.view import Blocks, MaskedView, PosedView


class SurfaceCarrier:
    """Carries values of surfaces from view to view, by the noise of their depth and a margin."""

    def __init__(self, sigma_per_m2: float, margin_m: float) -> None:
        self._noise = SIGMAS * np.sqrt(2) * sigma_per_m2
        self._margin_m = margin_m

    def carried(self, view: PosedView, other: MaskedView) -> Floats:
        """When the surfaces (h, w) of a view move, by another that sees them there, else never."""
        places = self._places(view.frame.inverse_depth, view, other.view)
        return np.where(places >= 0, other.moved_s.ravel()[places], np.float32(np.inf))

    def seen_still(
        self, view: PosedView, asked: Blocks, witnesses: Sequence[MaskedView]
    ) -> NDArray[np.int32]:
        """By how many views more a block (h, w) of a view is seen to stand still than to move.

        Of those that are asked for. Floor beside a foot, that one mask has covered, moves in that
        view alone.
        """
        inverse_depth = np.where(asked, view.frame.inverse_depth, np.float32(0))
        votes = np.zeros(asked.shape, np.int32)
        for witness in witnesses:
            places = self._places(inverse_depth, view, witness.view)
            _count_still(votes, places, np.isfinite(witness.moved_s))
        return votes

    def _places(
        self, inverse_depth: Floats, view: PosedView, other: PosedView
    ) -> NDArray[np.int32]:
        """Of blocks (h, w) with depth those of the other view that see them, by number, or -1."""
        seen, to_other = other.frame.inverse_depth, projection(other, view)
        return _alike(inverse_depth, seen, to_other, self._noise, self._margin_m)


@compiled
def _alike(
    inverse_depth: Floats, seen: Floats, to_other: Projection, noise: float, margin_m: float
) -> NDArray[np.int32]:
    """The loop of `SurfaceCarrier._places`."""
    height, width = inverse_depth.shape
    places, seen_at = np.full((height, width), -1, np.int32), seen.ravel()
    for v in range(height):
        for u in range(width):
            w = inverse_depth[v, u]
            if w == 0:
                continue
            place, expected = place_of(v, u, w, to_other, height, width)
            if place >= 0 and is_in_place(expected, seen_at[place], noise, margin_m):
                places[v, u] = place
    return places


@compiled
def _count_still(votes: NDArray[np.int32], places: NDArray[np.int32], moves: Blocks) -> None:
    """One more, in place, where the block at a place stands still, one less where it moves."""
    votes_of, seen_at, moves_at = votes.ravel(), places.ravel(), moves.ravel()
    for k in range(len(seen_at)):
        if seen_at[k] >= 0:
            votes_of[k] += -1 if moves_at[seen_at[k]] else 1
