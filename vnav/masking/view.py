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
class Surroundings:
    """What a view sees about each of its blocks.

    ``nearest`` and ``farthest`` (h, w): largest inverse depth, and smallest that is known, 0 where
    there is none; ``clear`` (h, w): blocks about which all has depth: nothing thin is hidden there.
    """

    nearest: Floats
    farthest: Floats
    clear: Blocks

    @classmethod
    def of(cls, inverse_depth: Floats, blocks: int) -> "Surroundings":
        """Of inverse depth (h, w), up to so many blocks to either side."""
        around = np.ones((2 * blocks + 1, 2 * blocks + 1), np.uint8)
        known = inverse_depth > 0
        least = cv2.erode(np.where(known, inverse_depth, np.float32(np.inf)), around)
        edge = cv2.BORDER_CONSTANT  # beyond the image nothing is known
        clear = cv2.erode(known.astype(np.uint8), around, borderType=edge, borderValue=(0,)) > 0
        return cls(
            np.asarray(cv2.dilate(inverse_depth, around), np.float32),
            np.where(np.isfinite(least), least, np.float32(0)),
            np.asarray(clear),
        )


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
    def to_track(self) -> Array:
        """What takes (u, v, 1, inverse depth) of its blocks to the track, over depth (4, 4)."""
        back = np.eye(4)
        back[:3, :3] = np.linalg.inv(self.frame.intrinsics.K)
        return self.T_track_camera @ back

    @cached_property
    def from_track(self) -> Array:
        """What takes a point of the track to (u, v, 1) of its blocks, times z (3, 4)."""
        return self.frame.intrinsics.K @ self.T_camera_track[:3]

    @cached_property
    def surfaces(self) -> NDArray[np.int32]:
        """The number of each block's surface (h, w), 0 where there is no depth."""
        return surfaces(self.frame)

    def about(self, blocks: int) -> Surroundings:
        """What it sees about each block, up to so many to either side."""
        if blocks not in self._about:
            self._about[blocks] = Surroundings.of(self.frame.inverse_depth, blocks)
        return self._about[blocks]

    @cached_property
    def _about(self) -> dict[int, Surroundings]:
        """What has been asked for, by how far it reaches."""
        return {}


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

    def with_attached(self, masked: MaskedView, others: Sequence[PosedView]) -> Floats:
        """What moves in a view (h, w), with surfaces that are of one body with it, by others."""

    def add(self, view: PosedView) -> None:
        """Take the view that was looked at last for one that later ones are held against."""

    def forget(self) -> None:
        """Begin anew: the poses of later views have another frame of reference."""
