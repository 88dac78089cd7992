"""Recordings of Record3D: one .r3d file, a zip of metadata and of rgbd/N.jpg, N.depth and N.conf.

Depth is float32 in metres, row by row, with colour's axis and view in fewer pixels; confidence is a
byte a pixel of it. Both are compressed by LZFSE. The poses of the metadata begin at the first
camera, and nothing tells where is up, so none are taken.

Source: issues 7, 24, 27, 83 and 93 of github.com/marek-simonik/record3d, by the app's author.
"""

import dataclasses
import hashlib
import json
import math
import re
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any, cast

import numpy as np

from vnav.config import CaptureConfig
from vnav.core.arrays import Array
from vnav.core.camera import Camera, Intrinsics, registered_camera
from vnav.core.frame import Frame
from vnav.errors import CameraError, CaptureError
from vnav.io.cameras.tables import from_corner, is_number, pinhole
from vnav.io.formats.camera_file import read_camera
from vnav.io.formats.images import image_of
from vnav.io.formats.record3d_file import MOST_BYTES, Record3dArchive, require_imagecodecs
from vnav.io.sources.open_capture import require_units
from vnav.io.sources.rectify import rectified, rectifier

SUFFIX = ".r3d"
UNITS_PER_METRE = 1.0
MOST_S = 1e12  # of a time: no clock is as far

_METADATA = "metadata"
_COLOR = re.compile(r"rgbd/(0|[1-9][0-9]{0,8})\.jpg")
_CAMERA = ("fx", "fy", "cx", "cy")
Values = Mapping[str, Any]  # of the metadata


def is_recording(path: Path) -> bool:
    """Whether it is a file that is called like a recording of Record3D."""
    return path.suffix.lower() == SUFFIX and path.is_file()


class Record3dCapture:
    """Frames of a recording: read, undistorted, registered; no poses."""

    has_depth = True
    poses = None

    def __init__(
        self,
        archive: Record3dArchive,
        numbers: tuple[int, ...],
        stamps_s: Array,
        cameras: tuple[Camera, ...],
    ) -> None:
        self._archive, self._numbers, self._cameras = archive, numbers, cameras
        self.stamps_s = stamps_s

    @property
    def name(self) -> str:
        """Name of the file, without suffix."""
        return self._archive.path.resolve().stem

    @property
    def camera(self) -> Camera:
        """The first frame's."""
        return self._cameras[0]

    def __len__(self) -> int:
        return len(self._numbers)

    def read(self, index: int) -> Frame:
        """One frame, undistorted and registered; CaptureError names a member that is damaged."""
        camera, (color_name, depth_name, sure_name) = self._cameras[index], self._members(index)
        where = self._archive.where(color_name)
        color, lens = image_of(self._archive.read(color_name), where), rectifier(camera)
        if color.shape[1::-1] != camera.color.size:
            raise CaptureError(
                f"expected {camera.color.width} x {camera.color.height} pixels in {where}, as its"
                f" camera has, found {color.shape[1]} x {color.shape[0]}"
            )
        size = (camera.depth or camera.color).size
        depth = self._archive.image(depth_name, "<f4", size)
        is_depth = np.isfinite(depth) & (depth > 0)
        if sure_name in self._archive.sizes:
            is_depth &= self._archive.image(sure_name, "u1", size) > 0
        depth_m = lens.depth_m(np.where(is_depth, depth, np.float32(0)))
        stamp_s = float(self.stamps_s[index])
        return Frame(0, index, stamp_s, lens.color(color), depth_m, rectified(camera))

    def fingerprint(self) -> str:
        """A hash of times, cameras and members."""
        with ThreadPoolExecutor() as pool:
            members = list(pool.map(self._digest, range(len(self))))
        cameras = [dataclasses.asdict(camera) for camera in self._cameras]
        text = json.dumps([self.stamps_s.tolist(), cameras, members], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    def _members(self, index: int) -> tuple[str, str, str]:
        """Names of a frame's colour, depth and confidence."""
        colour, depth, sure = (_member(self._numbers[index], k) for k in ("jpg", "depth", "conf"))
        return colour, depth, sure

    def _digest(self, index: int) -> list[str]:
        """Hashes of a frame's members, or what is wrong with them."""
        found = list[str]()
        for name in self._members(index):
            try:
                found.append(hashlib.sha256(self._archive.read(name)).hexdigest())
            except CaptureError:
                found.append("unreadable" if name in self._archive.sizes else "missing")
        return found


def open_recording(
    path: Path, config: CaptureConfig, camera_file: Path | None = None
) -> Record3dCapture:
    """The frames of a recording, by time; of several with the same time the first is kept.

    Their cameras are that of ``camera_file``, else each frame's own, else that of all;
    ``config.units_per_metre`` above 0 replaces the units, which are metres. CaptureError where
    there are no frames with depth, CameraError where there is no camera.
    """
    require_imagecodecs(path)
    require_units(config)
    archive = Record3dArchive(path)
    values = _metadata(archive)
    numbers = sorted(int(found[1]) for found in map(_COLOR.fullmatch, archive.sizes) if found)
    if not any(_member(number, "depth") in archive.sizes for number in numbers):
        raise CaptureError(
            f"expected colour and depth such as rgbd/0.jpg and rgbd/0.depth in {path}, found"
            f" {len(numbers)} images without depth; record with a phone that has a LiDAR"
        )
    by_stamp: dict[float, int] = {}
    for number, stamp_s in zip(numbers, _stamps_s(archive, values, numbers, config), strict=True):
        by_stamp.setdefault(stamp_s, number)
    stamps_s = sorted(by_stamp)
    numbers = [by_stamp[stamp_s] for stamp_s in stamps_s]
    units = config.units_per_metre
    if camera_file is not None:
        cameras = [read_camera(camera_file, units_per_metre=units)] * len(numbers)
    else:
        colors = _colors(archive, values, numbers)
        size = _depth_size(archive, values, numbers, colors[0].size)
        cameras = [registered_camera(c, units or UNITS_PER_METRE, size) for c in colors]
    return Record3dCapture(archive, tuple(numbers), np.array(stamps_s), tuple(cameras))


def _member(number: int, suffix: str) -> str:
    return f"rgbd/{number}.{suffix}"


def _metadata(archive: Record3dArchive) -> Values:
    try:
        values = json.loads(archive.read(_METADATA))
    except (ValueError, RecursionError) as error:
        raise CaptureError(
            f"expected JSON in {archive.where(_METADATA)}, found: {error}"
        ) from error
    if not isinstance(values, dict):
        raise CaptureError(f"expected a table in {archive.where(_METADATA)}, found {values!r:.40}")
    return values


def _stamps_s(
    archive: Record3dArchive, values: Values, numbers: Sequence[int], config: CaptureConfig
) -> list[float]:
    """Times of frames: those told, else by the rate."""
    told = _one_each(values, "frameTimestamps", numbers)
    if told is None:
        rate_hz = values.get("fps")
        if not (is_number(rate_hz) and rate_hz > 0):
            rate_hz = config.frame_rate_hz
        return [number / rate_hz for number in numbers]
    if not all(type(stamp_s) in (int, float) and abs(stamp_s) < MOST_S for stamp_s in told):
        raise CaptureError(
            f"expected times as frameTimestamps in {archive.where(_METADATA)}, found others"
        )
    return [float(stamp_s) for stamp_s in told]


def _one_each(values: Values, key: str, numbers: Sequence[int]) -> list[Any] | None:
    """What a list tells of each of these frames, None where it does not reach as far."""
    told = values.get(key)
    if not isinstance(told, list) or len(told) <= max(numbers):
        return None
    return [told[number] for number in numbers]


def _colors(archive: Record3dArchive, values: Values, numbers: Sequence[int]) -> list[Intrinsics]:
    """The colour camera of each frame: its own, else that of all."""
    where = archive.where(_METADATA)
    each = _one_each(values, "perFrameIntrinsicCoeffs", numbers)
    try:
        if each is None:
            each = [list(pinhole(values.get("K"), by_columns=True).values())] * len(numbers)
        width, height = int(values["w"]), int(values["h"])
        own = [dict(zip(_CAMERA, one, strict=True)) for one in each]
        if not all(is_number(value) for one in own for value in one.values()):
            raise ValueError("what are no numbers")
    except (LookupError, OverflowError, TypeError, ValueError) as error:
        raise CameraError(f"expected w, h and K of a camera in {where}, found: {error}") from error
    colors = [Intrinsics(width, height, **from_corner(one)) for one in own]
    for color in colors:
        if not color.is_possible:
            raise CameraError(f"expected a possible camera in {where}, found {color}")
    return colors


def _depth_size(
    archive: Record3dArchive, values: Values, numbers: Sequence[int], color: tuple[int, int]
) -> tuple[int, int]:
    """Width and height of depth: as told, else of colour's shape by the number of its pixels."""
    told = values.get("dw"), values.get("dh")
    if all(type(side) is int and 0 < side <= most for side, most in zip(told, color, strict=True)):
        return cast(tuple[int, int], told)
    most = min(color[0] * color[1], MOST_BYTES)
    for name in (_member(number, "depth") for number in numbers):
        with suppress(CaptureError):
            pixels = len(archive.values(name, "<f4", most))
            width = round(math.sqrt(pixels * color[0] / color[1]))
            if width and pixels % width == 0:
                return width, pixels // width
    raise CaptureError(
        f"expected the size of depth as dw and dh in {archive.where(_METADATA)}, found none, nor"
        " depth that tells it"
    )
