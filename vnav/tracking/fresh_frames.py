"""Frames of which one image is the frame before's: a camera that is slower than the other."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.core.frame import Frame

SOME_ROWS = slice(None, None, 16)  # that tell images apart, nearly always
STALE = "its {} image is that of the frame before; record colour and depth at one rate"


class FreshFrames:
    """Frames in order; two of which both images are the same show a still scene, and are fresh."""

    def __init__(self) -> None:
        self._before: Frame | None = None

    def repeated(self, frame: Frame) -> str:
        """Why colour and depth of the next frame are not of one moment; "" where they may be."""
        before, self._before = self._before, frame
        if before is None or not (before.depth_m.any() and frame.depth_m.any()):
            return ""
        color = _are_same(before.color, frame.color)
        if color == _are_same(before.depth_m, frame.depth_m):
            return ""
        return STALE.format("colour" if color else "depth")


def _are_same(a: NDArray[Any], b: NDArray[Any]) -> bool:
    return np.array_equal(a[SOME_ROWS], b[SOME_ROWS]) and np.array_equal(a, b)
