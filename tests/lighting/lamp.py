"""The tiny capture as a camera with a lamp beside it records it."""

from collections.abc import Callable

import numpy as np

from vnav.core.arrays import Array
from vnav.core.camera import Camera
from vnav.core.frame import Frame
from vnav.io.sources.capture import Capture
from vnav.synthetic.sensor import Sensor, measured_color


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
