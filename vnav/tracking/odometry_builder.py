"""What the odometry stage asks of whatever gives frames their poses."""

from collections.abc import Mapping
from typing import Protocol

from vnav.core.frame import Frame
from vnav.core.mapping import FrameFeatures, FrameTable, Odometry
from vnav.core.reduced_frame import ReducedFrame
from vnav.masking.view import Blocks


class OdometryBuilder(Protocol):
    """Takes a capture's frames in order, and makes the odometry of them."""

    def add(self, features: FrameFeatures, frame: Frame, image: ReducedFrame) -> bool:
        """Take the next frame, with its pixels in blocks; True where it becomes a keyframe."""

    @property
    def moving(self) -> Mapping[int, Blocks]:
        """Blocks (h, w) that move, of frames that are kept, by row; final with the result."""

    def skip(self, row: int, reason: str) -> None:
        """Leave the next frame out, and say why."""

    def result(self, frames: FrameTable) -> Odometry:
        """The odometry of all frames; CaptureError where not one became a keyframe."""
