"""Frames tracked by all their pixels, where their features show too little."""

from collections import deque

import numpy as np

from vnav.config import Config
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.frame import Frame, Rejected
from vnav.registration.dense import DenseEstimate, align
from vnav.tracking.motion import MAX_STEPS

STEPS_KEPT = 30  # times between frames, whose median is the usual one


class DenseTracker:
    """Aligns the current frame with the last tracked one."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._last: tuple[int, Frame] | None = None
        self._steps_s: deque[float] = deque(maxlen=STEPS_KEPT)
        self._degenerate_frames = 0

    @property
    def last_row(self) -> int | None:
        """Row of the last tracked frame, None before there is one."""
        return self._last[0] if self._last else None

    @property
    def is_degenerate(self) -> bool:
        """Whether a degenerate edge alone holds the last tracked frame."""
        return self._degenerate_frames > 0

    def track(
        self, frame: Frame, camera: Intrinsics, predicted: Array | None
    ) -> dict[int, DenseEstimate]:
        """The motion from the last tracked frame, by its row, near the predicted one.

        Empty where the pixels do not tell, after a gap in time, and where too many frames in a row
        have been degenerate.
        """
        if self._last is None or predicted is None or self._has_gap(frame):
            return {}
        if self._degenerate_frames >= self._config.odometry.max_degenerate_frames:
            return {}
        row, last = self._last
        estimate = align(last, frame, camera, self._config.registration, predicted)
        return {} if isinstance(estimate, Rejected) else {row: estimate}

    def remember(self, row: int, frame: Frame, degenerate: bool) -> None:
        """Make this the last tracked frame; ``degenerate``: a degenerate edge alone holds it."""
        if self._last is not None:
            self._steps_s.append(frame.stamp_s - self._last[1].stamp_s)
        self._last = row, frame
        self._degenerate_frames = self._degenerate_frames + 1 if degenerate else 0

    def _has_gap(self, frame: Frame) -> bool:
        """Whether too long a time lies between the last frame and this one, or none is usual."""
        assert self._last is not None
        step_s = frame.stamp_s - self._last[1].stamp_s
        return not self._steps_s or step_s > MAX_STEPS * float(np.median(self._steps_s))
