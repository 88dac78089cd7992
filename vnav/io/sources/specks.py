"""Depth without specks: single wrong pixels, as of interference, sunlight and flying pixels."""

import cv2
import numpy as np
from numpy.typing import NDArray

MOST_PX = 4  # of a speck; larger patches may be things
UNLIKE_PER_M = 0.008  # in inverse depth from pixel to pixel: 4 sigma of two pixels of a Kinect
STEPS = 6000.0  # of inverse depth in 1/m, so that 16 bits reach to 0.18 m


def without_specks(depth_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """Depth (H, W) in metres, 0 where at most `MOST_PX` pixels are unlike the depth around them.

    A speck with no depth beside it stays: nothing contradicts it.
    """
    steps = np.divide(STEPS, depth_m, out=np.zeros_like(depth_m), where=depth_m > 0)
    patches = np.minimum(steps, np.iinfo(np.int16).max).astype(np.int16)
    known = patches > 0
    cv2.filterSpeckles(patches, 0, MOST_PX, UNLIKE_PER_M * STEPS)
    specks = known & (patches == 0)
    if not specks.any():
        return depth_m
    beside = cv2.dilate((patches > 0).view(np.uint8), np.ones((3, 3), np.uint8))
    return np.where(specks & (beside > 0), np.float32(0), depth_m)
