"""What moves in one view, found in another: surfaces that both see in the same place.

Who stands still is where he was. Who walks is mostly there, too, in the frame beside.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core import se3
from vnav.core.arrays import Floats
from vnav.masking.free_space import SIGMAS, block_places
from vnav.masking.view import Blocks, MaskedView, PosedView


class SurfaceCarrier:
    """Carries values of surfaces from view to view, by the noise of their depth and a margin."""

    def __init__(self, sigma_per_m2: float, margin_m: float) -> None:
        self._tolerance = SIGMAS * np.sqrt(2) * sigma_per_m2, margin_m

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
        K = view.frame.intrinsics
        T = se3.inverse(other.T_track_camera) @ view.T_track_camera
        places, expected = block_places(inverse_depth, T, np.array([K.fx, K.fy, K.cx, K.cy]))
        _leave_seen(places, expected, other.frame.inverse_depth, *self._tolerance)
        return places


@compiled
def _leave_seen(
    places: NDArray[np.int32],
    expected: Floats,
    inverse_depth: Floats,
    noise: float,
    margin_m: float,
) -> None:
    """Take away places (h, w) whose depth is another than that expected there, in place."""
    height, width = places.shape
    for v in range(height):
        for u in range(width):
            if places[v, u] >= 0:
                i, j = divmod(places[v, u], width)
                seen = inverse_depth[i, j]
                off = abs(expected[v, u] - seen)
                if seen == 0 or off >= noise + margin_m * expected[v, u] * seen:
                    places[v, u] = -1
