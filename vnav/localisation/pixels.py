"""The pixels of a photo and of the map's keyframes, which tell places apart that look alike."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.core.camera import Intrinsics
from vnav.core.frame import Frame

COLUMNS = 160  # of a photo in small


@dataclass(frozen=True)
class Pixels:
    """A photo (H, W, 3) uint8 RGB by its camera, and keyframes by their number."""

    image: NDArray[np.uint8]
    camera: Intrinsics
    keyframe: Callable[[int], Frame]

    @cached_property
    def photo(self) -> NDArray[np.float32]:
        """The photo in small (h, w, 3), without distortion."""
        width = min(COLUMNS, self.camera.width)
        size = width, max(1, round(width * self.camera.height / self.camera.width))
        small = cv2.resize(self.image, size, interpolation=cv2.INTER_AREA)
        if any(self.camera.distortion):
            K, bent = self.camera.scaled(*size).K, np.array(self.camera.distortion)
            small = cv2.undistort(small, K, bent)
        return np.asarray(small, np.float32)
