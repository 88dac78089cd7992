"""What every capture reader offers, and the choice of the reader."""

from typing import Protocol

from vnav.core.camera import Camera
from vnav.core.frame import Frame


class Capture(Protocol):
    """Frames of one capture, in order of time; read one by one, from any thread."""

    @property
    def name(self) -> str:
        """Name of the folder."""

    @property
    def camera(self) -> Camera:
        """The camera as described; frames are delivered undistorted and registered."""

    def __len__(self) -> int:
        """Number of frames that have both colour and depth."""

    def stamp_s(self, index: int) -> float:
        """Time of the colour image of a frame."""

    def read(self, index: int) -> Frame:
        """One frame, undistorted and registered; CaptureError names a file that is damaged."""

    def fingerprint(self) -> str:
        """A hash of the capture's content: file names, bytes and camera."""
