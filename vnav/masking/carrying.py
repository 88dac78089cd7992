"""What moves in one view, found in another: surfaces that both see in the same place.

Who stands still is where he was. Who walks is mostly there, too, in the frame beside.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Floats
from vnav.masking.free_space import SIGMAS, is_in_place, places_in
from vnav.masking.view import Blocks, MaskedView, PosedView


class SurfaceCarrier:
    """Carries values of surfaces from view to view, by the noise of their depth and a margin."""

    def __init__(self, sigma_per_m2: float, margin_m: float) -> None:
        self._noise = SIGMAS * np.sqrt(2) * sigma_per_m2
        self._margin_m = margin_m

    def carried(self, view: PosedView, other: MaskedView) -> Floats:
        """When the surfaces (h, w) of a view move, by another that sees them there, else never."""
        places = self._places(view, other.view)
        return np.where(places >= 0, other.moved_s.ravel()[places], np.float32(np.inf))

    def seen_still(self, view: PosedView, witnesses: Sequence[MaskedView]) -> NDArray[np.int32]:
        """By how many views more a block (h, w) of a view is seen to stand still than to move.

        Floor beside a foot, that one mask has covered, moves in that view alone.
        """
        still = np.zeros(view.frame.grey.shape, np.int32)
        for witness in witnesses:
            _count_still(still, self._places(view, witness.view), np.isfinite(witness.moved_s))
        return still

    def _places(self, view: PosedView, other: PosedView) -> NDArray[np.int32]:
        """Of blocks (h, w) with depth those of the other view that see them, by number, or -1."""
        places, expected = places_in(other, view)
        _drop_unlike(places, expected, other.frame.inverse_depth, self._noise, self._margin_m)
        return places


@compiled
def _drop_unlike(
    places: NDArray[np.int32],
    expected: Floats,
    inverse_depth: Floats,
    noise: float,
    margin_m: float,
) -> None:
    """Make places -1, in place, where another view's depth is not as expected."""
    place_of, expected_of, depth_of = places.ravel(), expected.ravel(), inverse_depth.ravel()
    for k in range(len(place_of)):
        if place_of[k] < 0:
            continue
        if not is_in_place(expected_of[k], depth_of[place_of[k]], noise, margin_m):
            place_of[k] = -1


@compiled
def _count_still(still: NDArray[np.int32], places: NDArray[np.int32], moves: Blocks) -> None:
    """One more, in place, where the block at a place stands still, one less where it moves."""
    votes, place_of, moves_at = still.ravel(), places.ravel(), moves.ravel()
    for k in range(len(place_of)):
        if place_of[k] >= 0:
            votes[k] += -1 if moves_at[place_of[k]] else 1
