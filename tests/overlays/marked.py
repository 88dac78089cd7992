"""The tiny capture with text and a part of the robot in every image."""

import dataclasses

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.core.frame import Frame
from vnav.io.sources.capture import Capture
from vnav.io.sources.derived import DerivedCapture

TEXT = "2026-11-25 CAM 1"
BUMPER = 0.9  # of the height, from which on the robot is seen
TREMOR_PX, PASSING = 1, 0.4  # of a camera on a stand, and the share of its view that is hidden


class Marked(DerivedCapture):
    """A capture with bright text above, and something striped below that has depth of its own."""

    def __init__(self, whole: Capture) -> None:
        super().__init__(whole)
        self.marks = self._drawn(np.zeros_like(whole.read(0).color)).any(-1)

    def read(self, index: int) -> Frame:
        frame = super().read(index)
        depth_m = frame.depth_m.copy()
        depth_m[round(BUMPER * len(depth_m)) :] = 0.4
        return dataclasses.replace(frame, color=self._drawn(frame.color), depth_m=depth_m)

    def _drawn(self, color: NDArray[np.uint8]) -> NDArray[np.uint8]:
        height, width = color.shape[:2]
        drawn = color.copy()
        at, size = (width // 20, height // 8), width / 480
        cv2.putText(drawn, TEXT, at, cv2.FONT_HERSHEY_SIMPLEX, size, (230, 230, 230), 1)
        below = drawn[round(BUMPER * height) :]
        below[:] = 60
        below[:, :: width // 40] = 200
        return drawn


class Resting(DerivedCapture):
    """A capture by a camera that stands still but for some frames at its end."""

    def __init__(self, whole: Capture, moving: int) -> None:
        super().__init__(whole)
        self._moving = moving

    def read(self, index: int) -> Frame:
        return super().read(max(index - len(self) + self._moving, 0))


class Standing(DerivedCapture):
    """By a camera that trembles on its stand; something else to be seen each time walks past it."""

    def read(self, index: int) -> Frame:
        frame, passing = super().read(0), super().read(index).color
        tremor = np.random.default_rng(index).integers(-TREMOR_PX, TREMOR_PX + 1, 2)
        color = np.roll(frame.color, tremor, (0, 1))
        width = round(PASSING * color.shape[1])
        left = round(index / (len(self) - 1) * (color.shape[1] - width))
        color[:, left : left + width] = passing[:, left : left + width]
        return dataclasses.replace(frame, color=color)
