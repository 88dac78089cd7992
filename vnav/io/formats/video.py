"""Videos as images by number: exact, from any thread, fast where they are read in order.

OpenCV seeks by time, which a phone's uneven frames make inexact. So frames are decoded one after
the other, and those on the way that other threads wait for are kept for them.
"""

import threading
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.errors import CaptureError

MOST_FRAMES = 2**31  # more than any video has


class Video:
    """The frames of a video file, as they were recorded: its orientation is not applied."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._decoding = threading.Lock()
        self._wanted: list[int] = []  # by threads that wait
        self._kept: dict[int, NDArray[Any]] = {}
        self._source: cv2.VideoCapture | None = None
        self._next, self._end = 0, MOST_FRAMES

    def __reduce__(self) -> tuple[type["Video"], tuple[Path]]:
        """For another process, which opens the file itself."""
        return Video, (self._path,)

    def read(self, number: int) -> NDArray[np.uint8]:
        """A frame (H, W, 3) uint8, RGB; CaptureError where it cannot be decoded."""
        bgr = self._frame(number, converted=True)
        return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), np.uint8)

    def read_depth(self, number: int) -> NDArray[np.uint16]:
        """A frame (H, W) uint16 as stored; CaptureError also where it is of another kind."""
        depth = self._frame(number, converted=False)
        if depth.dtype != np.uint16 or depth.ndim != 2:
            raise CaptureError(
                f"expected 16 bits a pixel in the video of depth {self._path}, found {depth.dtype};"
                " write it with ffmpeg -c:v ffv1 -pix_fmt gray16le"
            )
        return depth

    def _frame(self, number: int, converted: bool) -> NDArray[Any]:
        """A frame as OpenCV gives it: ``converted`` to BGR, or as stored."""
        self._wanted.append(number)
        try:
            with self._decoding:
                if number not in self._kept:
                    self._decode_to(number, converted)
                image = self._kept[number]
                if self._wanted.count(number) == 1:
                    del self._kept[number]
        finally:
            self._wanted.remove(number)
        return image

    def _decode_to(self, number: int, converted: bool) -> None:
        if self._source is None or number < self._next:
            self._source, self._next = _opened(self._path), 0
            self._source.set(cv2.CAP_PROP_CONVERT_RGB, float(converted))
        while self._next <= number < self._end:
            if not self._source.grab():
                self._end = self._next
            elif self._next in self._wanted:
                self._keep(self._source)
            self._next += 1
        if number >= self._end:
            raise CaptureError(
                f"expected frame {number} of the video {self._path}, found {self._end} that can be"
                " decoded"
            )

    def _keep(self, source: cv2.VideoCapture) -> None:
        is_whole, image = source.retrieve()
        if is_whole:
            self._kept[self._next] = np.asarray(image)
        else:
            self._end = self._next


def video_size(path: Path) -> tuple[int, int]:
    """Width and height of a video's frames; CaptureError where it cannot be read."""
    source = _opened(path)
    return int(source.get(cv2.CAP_PROP_FRAME_WIDTH)), int(source.get(cv2.CAP_PROP_FRAME_HEIGHT))


def frame_count(path: Path) -> int:
    """How many frames a video says that it has; CaptureError where it cannot be read."""
    return max(0, int(_opened(path).get(cv2.CAP_PROP_FRAME_COUNT)))


def frame_rate_hz(path: Path) -> float:
    """How many frames a second a video says that it has, 0 where it does not."""
    rate_hz = float(_opened(path).get(cv2.CAP_PROP_FPS))
    return rate_hz if np.isfinite(rate_hz) and rate_hz > 0 else 0.0


def _opened(path: Path) -> cv2.VideoCapture:
    if not path.is_file():
        raise CaptureError(f"expected a video at {path}, found none")
    source = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    if not source.isOpened():
        raise CaptureError(f"expected a video in {path}, found a file that cannot be decoded")
    source.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
    return source
