"""What a mask works on: frames in blocks of pixels with their poses, in the order of time."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.core import se3
from vnav.core.arrays import Array, Floats
from vnav.core.reduced_frame import ReducedFrame
from vnav.masking.surfaces import surfaces

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

    @property
    def stamp_s(self) -> float:
        """When the frame was taken."""
        return self.frame.stamp_s

    @cached_property
    def T_camera_track(self) -> Array:
        """The inverse of its pose."""
        return se3.inverse(self.T_track_camera)

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
    def surfaces(self) -> NDArray[np.int32]:
        """The number of each block's surface (h, w), 0 where there is no depth."""
        return surfaces(self.frame)

    @cached_property
    def clear(self) -> Blocks:
        """Blocks (h, w) with depth, and all about them: nothing thin is hidden there."""
        known = (self.frame.inverse_depth > 0).astype(np.uint8)
        edge = cv2.BORDER_CONSTANT  # beyond the image nothing is known
        return np.asarray(cv2.erode(known, AROUND, borderType=edge, borderValue=(0,)) > 0)


@dataclass(frozen=True)
class MaskedView:
    """A view and what moves in it.

    ``moved_s`` (h, w): seconds to the frame in which a block's surface is seen to move, infinity
    where it never is.
    """

    view: PosedView
    moved_s: Floats


def still(view: PosedView) -> Floats:
    """The times (h, w) of a view in which nothing moves."""
    return np.full(view.frame.grey.shape, np.inf, np.float32)


class Mask(Protocol):
    """Says what moves; it is asked and told frame by frame, from one thread."""

    def look(self, frame: ReducedFrame, T_track_camera: Array) -> PosedView:
        """The next frame as a view, held against the views that were added."""

    def moving(self, view: PosedView, others: Sequence[PosedView], carried: Floats) -> Floats:
        """Seconds (h, w) to the frame in which a block's surface is seen to move, else infinity.

        By other views near in time, and by what is ``carried`` (h, w) from the frames beside it.
        """

    def carried(
        self, view: PosedView, beside: MaskedView, witnesses: Sequence[MaskedView]
    ) -> Floats:
        """What moves in a view as it does in the one beside it in time; see `MaskedView`.

        It is carried unless most witnesses, views on that side, see it stand still.
        """

    def add(self, view: PosedView) -> None:
        """Take the view that was looked at last for one that later ones are held against."""

    def forget(self) -> None:
        """Begin anew: the poses of later views have another frame of reference."""
