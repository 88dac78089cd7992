"""The tiny capture as a camera with a lamp records it, or one under lamps that flicker."""

import dataclasses
from collections.abc import Callable

import numpy as np

from vnav.core.arrays import Array
from vnav.core.camera import Camera
from vnav.core.frame import Frame
from vnav.io.sources.capture import Capture
from vnav.io.sources.derived import DerivedCapture
from vnav.synthetic.sensor import Sensor, measured_color

SWING = 0.1  # of the brightness, to either side
ADVANCE = 0.37  # of a wave, from frame to frame: what the rates of camera and lamps leave


def lamp(r2: Array) -> Array:
    """How bright it is where the square of the distance is r2 of that of the corners: 0.3 there."""
    return 0.295 + 0.705 * np.exp(-5 * r2)


class LampLit:
    """Frames of a capture, brightness falling off from their centre; more noise comes after it."""

    name, has_depth, poses = "by a lamp", True, None

    def __init__(self, whole: Capture, light: Callable[[Array], Array] = lamp) -> None:
        self.whole, self.light = whole, light

    @property
    def camera(self) -> Camera:
        return self.whole.camera

    @property
    def stamps_s(self) -> np.ndarray:
        return self.whole.stamps_s

    def __len__(self) -> int:
        return len(self.whole)

    def read(self, index: int) -> Frame:
        frame = self.whole.read(index)
        left = self.light(squares(*frame.depth_m.shape))[..., None].astype(np.float32)
        rng = np.random.default_rng([1, index])
        lit = measured_color(frame.color * left, np.ones(3), Sensor(), rng)
        return Frame(0, index, frame.stamp_s, lit, frame.depth_m, frame.intrinsics)

    def fingerprint(self) -> str:
        return f"{self.whole.fingerprint()} by a lamp"


def squares(height: int, width: int) -> Array:
    """Squares (H, W) of the distances from the image centre, 1 in the corners."""
    y, x = np.mgrid[:height, :width]
    u, v = 2 * x - (width - 1), 2 * y - (height - 1)
    return np.asarray((u**2 + v**2) / ((width - 1) ** 2 + (height - 1) ** 2))


def bands(rows: np.ndarray, waves: float, index: int, swing: float = SWING) -> np.ndarray:
    """How bright shares (H,) of the image's height are in a frame."""
    return 1 + swing * np.sin(2 * np.pi * (waves * rows + ADVANCE * index))


def banded(frame: Frame, waves: float, index: int, swing: float = SWING) -> Frame:
    """A frame with bands; rounded, and clipped where it is too bright."""
    height = len(frame.color)
    light = bands((np.arange(height) + 0.5) / height, waves, index, swing)
    lit = np.clip(frame.color * light[:, None, None] + 0.5, 0, 255).astype(np.uint8)
    return dataclasses.replace(frame, color=lit)


class Flickering(DerivedCapture):
    """The frames of a capture with bands."""

    def __init__(self, whole: Capture, waves: float = 3.3, swing: float = SWING) -> None:
        super().__init__(whole)
        self._waves, self._swing = waves, swing

    def read(self, index: int) -> Frame:
        return banded(super().read(index), self._waves, index, self._swing)
