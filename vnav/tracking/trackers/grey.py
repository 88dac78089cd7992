"""Brightness, which trackers compare."""

import cv2
import numpy as np
from numpy.typing import NDArray


def grey_of(color: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Brightness (H, W) of an RGB image."""
    return np.asarray(cv2.cvtColor(np.asarray(color), cv2.COLOR_RGB2GRAY))
