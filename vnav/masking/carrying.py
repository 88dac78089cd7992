"""What moves in one view, found in another: surfaces that both see in the same place.

Who stands still is where he was. Who walks is mostly there, too, in the frame beside.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Floats
from vnav.masking.free_space import SIGMAS, places_in
from vnav.masking.view import Blocks, MaskedView, PosedView


class SurfaceCarrier:
    """Carries values of surfaces from view to view, by the noise of their depth and a margin."""

    def __init__(self, sigma_per_m2: float, margin_m: float) -> None:
        self._noise = SIGMAS * np.sqrt(2) * sigma_per_m2
        self._margin_m = np.float64(margin_m)

    def carried(self, view: PosedView, other: MaskedView) -> Floats:
        """When the surfaces (h, w) of a view move, by another that sees them there, else never."""
        w, values = view.frame.inverse_depth, other.moved_s
        places = self._places(view, other.view, w)
        return np.where(places >= 0, values.ravel()[places], np.float32(np.inf))

    def borne_out(self, view: PosedView, blocks: Blocks, witnesses: Sequence[MaskedView]) -> Blocks:
        """Of blocks (h, w) of a view, those that no majority of views see there and not moving.

        So floor beside a foot, that one mask has covered, moves in that view alone.
        """
        w = np.where(blocks, view.frame.inverse_depth, np.float32(0))
        against = np.zeros(blocks.shape, np.int32)
        for witness in witnesses:
            places = self._places(view, witness.view, w)
            moves = np.isfinite(witness.moved_s).ravel()[places]
            against += np.where(places >= 0, np.where(moves, -1, 1), 0)
        return blocks & (against <= 0)

    def _places(
        self, view: PosedView, other: PosedView, inverse_depth: Floats
    ) -> NDArray[np.int32]:
        """Of blocks (h, w) with depth those of the other view that see them, by number, or -1."""
        places, expected = places_in(other, view, inverse_depth)
        seen = other.frame.inverse_depth.ravel()[places]
        is_there = np.abs(expected - seen) < self._noise + self._margin_m * expected * seen
        return np.where((places >= 0) & (seen > 0) & is_there, places, np.int32(-1))
