"""What a mask works on: frames in blocks of pixels with their poses, in the order of time."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array, Floats
from vnav.core.reduced_frame import ReducedFrame

Blocks = NDArray[np.bool_]

AROUND = np.ones((3, 3), np.uint8)  # a block and its neighbours


@dataclass(frozen=True)
class PosedView:
    """A frame and where it was taken from.

    ``T_track_camera``: its pose in a frame of reference that it shares with the other views;
    ``changed`` (h, w): blocks whose brightness is not that of what stood there before.
    """

    frame: ReducedFrame
    T_track_camera: Array
    changed: Blocks

    @cached_property
    def nearest(self) -> Floats:
        """Largest inverse depth (h, w) about each block, 0 where there is none."""
        return np.asarray(cv2.dilate(self.frame.inverse_depth, AROUND), np.float32)

    @cached_property
    def farthest(self) -> Floats:
        """Smallest known inverse depth (h, w) about each block, 0 where there is none."""
        w = self.frame.inverse_depth
        known = np.where(w > 0, w, np.float32(np.inf))
        least = np.asarray(cv2.erode(known, AROUND), np.float32)
        return np.where(np.isfinite(least), least, np.float32(0))

    @cached_property
    def clear(self) -> Blocks:
        """Blocks (h, w) with depth, and all about them: nothing thin is hidden there."""
        known = (self.frame.inverse_depth > 0).astype(np.uint8)
        edge = cv2.BORDER_CONSTANT  # beyond the image nothing is known
        return np.asarray(cv2.erode(known, AROUND, borderType=edge, borderValue=(0,)) > 0)


class Mask(Protocol):
    """Says what moves; it is asked and told frame by frame, from one thread."""

    def look(self, frame: ReducedFrame, T_track_camera: Array) -> PosedView:
        """The next frame as a view, held against the views that were added."""

    def moving(self, view: PosedView, others: Sequence[PosedView]) -> Blocks:
        """Which blocks (h, w) of a view see something that moves, by other views near in time."""

    def add(self, view: PosedView) -> None:
        """Take the view that was looked at last for one that later ones are held against."""

    def forget(self) -> None:
        """Begin anew: the poses of later views have another frame of reference."""
