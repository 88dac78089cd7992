"""Frames followed by all their pixels, where their features show too little."""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from vnav.config import OdometryConfig
from vnav.core.frame import Frame, Rejected
from vnav.registration import Sensor
from vnav.registration.dense import DenseEstimate, align

LONGEST_STEP = 3.5  # of the usual time between frames: after a longer gap no motion is predicted
REMEMBERED = 30  # frames that tell what is usual


class DenseTracker:
    """Keeps the last tracked frame, to follow the next one from it."""

    def __init__(self, config: OdometryConfig) -> None:
        self._most = config.max_degenerate_frames
        self._last: tuple[int, Frame] | None = None
        self._steps_s: deque[float] = deque(maxlen=REMEMBERED)
        self._loose = 0

    @property
    def last(self) -> int | None:
        """Row of the last tracked frame, None before there is one."""
        return self._last[0] if self._last else None

    @property
    def hanging(self) -> bool:
        """Whether the last tracked frame is held loosely."""
        return self._loose > 0

    def follow(
        self, frame: Frame, sensor: Sensor, predicted: NDArray[np.float64] | None
    ) -> DenseEstimate | None:
        """How a frame stands to the last tracked one, near the predicted motion.

        None where the pixels do not tell, after a gap in time, and where too many frames in a row
        are held loosely already.
        """
        if self._last is None or predicted is None or self._loose >= self._most:
            return None
        _, last = self._last
        step_s = frame.stamp_s - last.stamp_s
        if not self._steps_s or step_s > LONGEST_STEP * float(np.median(self._steps_s)):
            return None
        found = align(last, frame, sensor.intrinsics, sensor.config, predicted)
        return None if isinstance(found, Rejected) else found

    def took(self, row: int, frame: Frame, loose: bool) -> None:
        """Remember a tracked frame, and whether it is held loosely."""
        if self._last is not None:
            self._steps_s.append(frame.stamp_s - self._last[1].stamp_s)
        self._last, self._loose = (row, frame), self._loose + 1 if loose else 0
