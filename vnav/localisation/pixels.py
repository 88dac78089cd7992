"""The pixels of a photo and of the map's keyframes, which tell places apart that look alike."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.core.camera import Intrinsics
from vnav.core.frame import Frame

COLUMNS = 160  # of a photo in small


@dataclass(frozen=True)
class Pixels:
    """A photo in small, (H, W, 3) float32 RGB without distortion, and keyframes by their number."""

    photo: NDArray[np.float32]
    keyframe: Callable[[int], Frame]


def reduced(image: NDArray[np.uint8], camera: Intrinsics) -> NDArray[np.float32]:
    """A photo (H, W, 3) by a camera in small, without distortion: for `Pixels`."""
    width = min(COLUMNS, camera.width)
    size = width, max(1, round(width * camera.height / camera.width))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    if any(camera.distortion):
        small = cv2.undistort(small, camera.scaled(*size).K, np.array(camera.distortion))
    return np.asarray(small, np.float32)
