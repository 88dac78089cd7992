"""No mask: everything stands still."""

from collections.abc import Sequence

import numpy as np

from vnav.config import Config
from vnav.core.arrays import Array, Floats
from vnav.core.reduced_frame import ReducedFrame
from vnav.masking.view import MaskedView, PosedView, still


class NoMask:
    """Takes nothing for moving."""

    def __init__(self, _config: Config) -> None:
        pass

    def look(self, frame: ReducedFrame, T_track_camera: Array) -> PosedView:
        """The frame, in which nothing has changed."""
        return PosedView(frame, T_track_camera, np.zeros(frame.grey.shape, bool))

    def moving(self, view: PosedView, _others: Sequence[PosedView], _carried: Floats) -> Floats:
        """Nothing."""
        return still(view)

    def carried(
        self, view: PosedView, _beside: MaskedView, _witnesses: Sequence[MaskedView]
    ) -> Floats:
        """Nothing."""
        return still(view)

    def with_attached(self, masked: MaskedView, _others: Sequence[PosedView]) -> Floats:
        """Nothing more."""
        return masked.moved_s

    def add(self, view: PosedView) -> None:
        """Nothing is held against it."""

    def forget(self) -> None:
        """There is nothing to forget."""
