"""A capture whose frames are pairs of image files, whatever format lists them."""

import hashlib
import json
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array
from vnav.core.camera import Camera
from vnav.core.frame import Frame, no_depth
from vnav.errors import CaptureError
from vnav.io.files import read_bytes
from vnav.io.formats.images import read_depth, read_image
from vnav.io.sources.frame_list import FrameList
from vnav.io.sources.rectify import Rectifier, rectified


class FolderCapture:
    """Frames from image files: read, undistorted, registered."""

    poses = None

    def __init__(
        self, root: Path, camera: Camera, files: FrameList, truth: Path | None = None
    ) -> None:
        self.root, self.camera, self.files, self.truth = root, camera, files, truth

    @property
    def name(self) -> str:
        """Name of the folder."""
        return self.root.resolve().name

    @property
    def has_depth(self) -> bool:
        """Whether there are depth images."""
        return self.files.has_depth

    def __len__(self) -> int:
        return len(self.files.pairs)

    @property
    def stamps_s(self) -> Array:
        """Times (N,) of the colour images."""
        return self.files.stamps_s

    def read(self, index: int) -> Frame:
        """One frame, undistorted and registered; CaptureError names a file that is damaged."""
        pair = self.files.pairs[index]
        color = read_image(pair.color.path)
        _require_size(pair.color.path, color, self.camera.color.size, "color")
        color = self._rectifier.color(color)
        depth_m = no_depth(*color.shape[:2])
        if pair.depth is not None:
            raw, sensor = read_depth(pair.depth.path), self.camera.depth or self.camera.color
            _require_size(pair.depth.path, raw, sensor.size, "depth")
            depth_m = self._rectifier.depth_m(raw)
        return Frame(0, index, pair.color.stamp_s, color, depth_m, rectified(self.camera))

    def fingerprint(self) -> str:
        """A hash of the capture's content: camera, and each frame's times, file names and bytes."""
        files = [image for pair in self.files.pairs for image in pair.images]
        with ThreadPoolExecutor() as pool:
            digests = list(pool.map(_digest, [file.path for file in files]))
        names = [os.path.relpath(file.path, self.root) for file in files]
        content = [
            [file.stamp_s, name, digest]
            for file, name, digest in zip(files, names, digests, strict=True)
        ]
        text = json.dumps([asdict(self.camera), content], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    @cached_property
    def _rectifier(self) -> Rectifier:
        return Rectifier(self.camera)


def _require_size(
    path: Path, image: NDArray[np.generic], size: tuple[int, int], section: str
) -> None:
    height, width = image.shape[:2]
    if (width, height) != size:
        raise CaptureError(
            f"expected {size[0]} x {size[1]} pixels in {path}, as [{section}] of its camera says,"
            f" found {width} x {height}; correct the camera or remove the image"
        )


def _digest(path: Path) -> str:
    """Hash of a file's bytes; a missing file has one too, for a capture may miss some."""
    try:
        return hashlib.sha256(read_bytes(path)).hexdigest()
    except OSError as error:
        return f"unreadable: {error.strerror}"
