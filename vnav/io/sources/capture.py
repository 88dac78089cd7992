"""What every source of frames offers; docs/captures.md says how to write one."""

from pathlib import Path
from typing import Protocol, runtime_checkable

from vnav.core.arrays import Array
from vnav.core.camera import Camera
from vnav.core.frame import Frame
from vnav.core.trajectory import Trajectory
from vnav.io.sources.frame_list import FrameList


class Capture(Protocol):
    """Frames of one recording, in order of time; read one by one, from any thread."""

    @property
    def name(self) -> str:
        """What the map calls it."""

    @property
    def camera(self) -> Camera:
        """The camera as described; where focal lengths change, the one that the map is made for."""

    @property
    def has_depth(self) -> bool:
        """Whether its frames have depth; where not, `Frame.depth_m` is 0 everywhere."""

    @property
    def stamps_s(self) -> Array:
        """Times (N,) of the colour images, ascending, each once."""

    @property
    def poses(self) -> Trajectory | None:
        """Poses of the colour camera that the source itself knows, for some frames or all."""

    def __len__(self) -> int:
        """Number of frames, N."""

    def read(self, index: int) -> Frame:
        """One frame, undistorted and registered; CaptureError says why it cannot be read.

        Its own intrinsics may differ from those of ``camera``.
        """

    def fingerprint(self) -> str:
        """A hash of the content that a map depends on: times, images and cameras."""


@runtime_checkable
class FileBacked(Protocol):
    """What a capture made of image files offers besides: each file can be checked and named."""

    @property
    def files(self) -> FrameList:
        """Which images make which frame, and which found no partner."""

    @property
    def truth(self) -> Path | None:
        """Where the true trajectory lies, None where there is none; for scoring only."""
