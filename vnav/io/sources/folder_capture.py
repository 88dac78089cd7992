"""A capture whose frames are pairs of image files, whatever format lists them."""

import hashlib
import json
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array
from vnav.core.camera import Camera
from vnav.core.frame import Frame, no_depth
from vnav.core.trajectory import Trajectory
from vnav.errors import CaptureError
from vnav.io.files import read_bytes
from vnav.io.formats.images import read_depth, read_gray, read_image
from vnav.io.formats.video import Video
from vnav.io.sources.frame_list import FrameList, ImageFile
from vnav.io.sources.rectify import rectified, rectifier


class FolderCapture:
    """Frames from image files: read, undistorted, registered."""

    def __init__(
        self, root: Path, camera: Camera, files: FrameList, truth: Path | None = None
    ) -> None:
        self.root, self.camera, self.files, self.truth = root, camera, files, truth
        self._videos: dict[Path, Video] = {}

    @property
    def name(self) -> str:
        """Name of the folder."""
        return self.root.resolve().name

    @property
    def has_depth(self) -> bool:
        """Whether there are depth images."""
        return self.files.has_depth

    @property
    def poses(self) -> Trajectory | None:
        """Those that the recorder stored."""
        return self.files.poses

    def __len__(self) -> int:
        return len(self.files.pairs)

    @property
    def stamps_s(self) -> Array:
        """Times (N,) of the colour images."""
        return self.files.stamps_s

    def read(self, index: int) -> Frame:
        """One frame, undistorted and registered; CaptureError names a file that is damaged."""
        pair = self.files.pairs[index]
        camera = pair.camera or self.camera
        lens, color = rectifier(camera), self._color(pair.color)
        _require_size(pair.color.path, color, camera.color.size, "color")
        color = lens.color(color)
        depth_m = no_depth(*color.shape[:2])
        if pair.depth is not None:
            raw, sensor = self._depth(pair.depth), camera.depth or camera.color
            raw = _believed(raw, pair.depth, pair.confidence)
            _require_size(pair.depth.path, raw, sensor.size, "depth")
            depth_m = lens.depth_m(raw)
        shown = color, depth_m, rectified(camera)
        return Frame(0, index, pair.color.stamp_s, *shown, depth_after_s=pair.offset_s)

    def _color(self, image: ImageFile) -> NDArray[np.uint8]:
        if image.video_frame is None:
            return read_image(image.path)
        return self._video(image).read(image.video_frame)

    def _depth(self, image: ImageFile) -> NDArray[np.uint16]:
        if image.video_frame is None:
            return read_depth(image.path)
        return self._video(image).read_depth(image.video_frame)

    def _video(self, image: ImageFile) -> Video:
        return self._videos.setdefault(image.path, Video(image.path))

    def fingerprint(self) -> str:
        """A hash of the capture's content: camera, and each frame's times, file names and bytes."""
        files = [image for pair in self.files.pairs for image in pair.images]
        paths = list(dict.fromkeys(file.path for file in files))
        with ThreadPoolExecutor() as pool:
            digests = dict(zip(paths, pool.map(_digest, paths), strict=True))
        content = [[file.stamp_s, _name(file, self.root), digests[file.path]] for file in files]
        cameras = [asdict(pair.camera) for pair in self.files.pairs if pair.camera]
        text = json.dumps([asdict(self.camera), content, *cameras], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()


def _believed(
    raw: NDArray[np.uint16], depth: ImageFile, confidence: ImageFile | None
) -> NDArray[np.uint16]:
    """Depth as stored, 0 where its confidence is."""
    if confidence is None:
        return raw
    levels = read_gray(confidence.path)
    if levels.shape != raw.shape:
        raise CaptureError(
            f"expected the confidence {confidence.path} to have the size of {depth.path}, found"
            f" {levels.shape[::-1]} and {raw.shape[::-1]}"
        )
    return np.where(levels > 0, raw, np.uint16(0))


def _name(image: ImageFile, root: Path) -> str:
    name = os.path.relpath(image.path, root)
    return name if image.video_frame is None else f"{name} {image.video_frame}"


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
