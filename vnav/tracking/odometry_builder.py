"""What the odometry stage asks of whatever gives frames their poses."""

from typing import Protocol

from vnav.core.frame import Frame
from vnav.core.mapping import FrameFeatures, FrameTable, Odometry
from vnav.core.reduced_frame import ReducedFrame


class OdometryBuilder(Protocol):
    """Takes a capture's frames in order, and makes the odometry of them."""

    def add(self, features: FrameFeatures, frame: Frame, image: ReducedFrame) -> bool:
        """Take the next frame, with its pixels in blocks; True where it becomes a keyframe."""

    def skip(self, row: int, reason: str) -> None:
        """Leave the next frame out, and say why."""

    def result(self, frames: FrameTable) -> Odometry:
        """The odometry of all frames; CaptureError where not one became a keyframe."""
