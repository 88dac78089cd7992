"""Frames followed by their depth alone, where their colours show too little."""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from vnav.config import OdometryConfig
from vnav.core.frame import Edge, Frame, Rejected
from vnav.posegraph import softened
from vnav.registration import Sensor
from vnav.registration.depth import align_depth

LONGEST_STEP = 1.5  # of the usual time between frames: after a gap no motion is predicted
REMEMBERED = 30  # frames that tell what is usual
SIGMA_RAD, SIGMA_M = np.deg2rad(0.3), 0.01  # added: what an open direction bends of the fixed


class DepthTracker:
    """Keeps the last tracked frame, to follow the next one from it."""

    def __init__(self, config: OdometryConfig) -> None:
        self._most = config.max_depth_only_frames
        self._farthest_m = config.max_depth_m
        self._last: tuple[int, Frame] | None = None
        self._steps_s: deque[float] = deque(maxlen=REMEMBERED)
        self._alone = 0

    @property
    def last(self) -> int | None:
        """Row of the last tracked frame, None before there is one."""
        return self._last[0] if self._last else None

    @property
    def hanging(self) -> bool:
        """Whether depth alone told the motion of the last tracked frame."""
        return self._alone > 0

    def edges(
        self, row: int, frame: Frame, sensor: Sensor, predicted: NDArray[np.float64] | None
    ) -> list[Edge]:
        """One from the last tracked frame by the predicted motion, none where depth does not tell.

        Nor after a gap in time, nor where too many frames were followed so already.
        """
        if self._last is None or predicted is None or self._alone >= self._most:
            return []
        last_row, last = self._last
        step_s = frame.stamp_s - last.stamp_s
        if not self._steps_s or step_s > LONGEST_STEP * float(np.median(self._steps_s)):
            return []
        before, now = (
            np.where(f.depth_m <= self._farthest_m, f.depth_m, np.float32(0)) for f in (last, frame)
        )
        found = align_depth(before, now, sensor.intrinsics, sensor.config, predicted)
        if isinstance(found, Rejected):
            return []
        edge = Edge(last_row, row, found.T_a_b, found.information)
        return [softened(edge, SIGMA_RAD, SIGMA_M)]

    def took(self, row: int, frame: Frame, alone: bool) -> None:
        """Remember a tracked frame, and whether depth alone told its motion."""
        if self._last is not None:
            self._steps_s.append(frame.stamp_s - self._last[1].stamp_s)
        self._last, self._alone = (row, frame), self._alone + 1 if alone else 0
