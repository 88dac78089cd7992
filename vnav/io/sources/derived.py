"""Captures that are made of another, which they are like but for what they change."""

from vnav.core.arrays import Array
from vnav.core.camera import Camera
from vnav.core.frame import Frame
from vnav.core.trajectory import Trajectory
from vnav.io.sources.capture import Capture


class DerivedCapture:
    """A capture as it is: all of `Capture` is asked of ``whole``."""

    def __init__(self, whole: Capture) -> None:
        self._whole = whole

    @property
    def name(self) -> str:
        """That of the whole."""
        return self._whole.name

    @property
    def camera(self) -> Camera:
        """That of the whole."""
        return self._whole.camera

    @property
    def has_depth(self) -> bool:
        """Whether the whole has."""
        return self._whole.has_depth

    @property
    def stamps_s(self) -> Array:
        """Times (N,) of the frames."""
        return self._whole.stamps_s

    @property
    def poses(self) -> Trajectory | None:
        """Those of the whole: poses belong to frames by their times."""
        return self._whole.poses

    def __len__(self) -> int:
        return len(self._whole)

    def read(self, index: int) -> Frame:
        """A frame of the whole."""
        return self._whole.read(index)

    def fingerprint(self) -> str:
        """That of the whole."""
        return self._whole.fingerprint()
