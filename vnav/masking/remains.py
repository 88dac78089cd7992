"""What a mask leaves of what moves: small surfaces beside it, as a shoe behind a leg."""

import cv2
import numpy as np

from vnav.core.reduced_frame import ReducedFrame
from vnav.masking.regions import LEAST_SHARE
from vnav.masking.surfaces import surfaces
from vnav.masking.view import Blocks

REACH = 2  # blocks past the margin of a mask


def remains(frame: ReducedFrame, moving: Blocks, margin: int) -> Blocks:
    """Which blocks (h, w) of a frame may be of what moves, though its mask does not cover them.

    They are of surfaces that are smaller than a body may be, and beside the mask. ``moving`` (h, w)
    is the mask; ``frame`` has no depth there, nor within so many blocks of a ``margin``.
    """
    number = surfaces(frame)
    side = 2 * (margin + REACH) + 1
    beside = cv2.dilate(moving.astype(np.uint8), np.ones((side, side), np.uint8)) > 0
    is_beside = np.zeros(number.max() + 1, bool)
    is_beside[number[beside]] = True
    is_small = np.bincount(number.ravel()) < LEAST_SHARE * number.size
    return np.asarray((is_beside & is_small)[number] & (number > 0))
