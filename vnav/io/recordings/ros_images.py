"""Images of ROS messages as image files: JPEG and PNG as they came, raw pixels as PNG.

Raw: sensor_msgs/image_encodings.h, sizes as cv_bridge demands them. Compressed: the "compressed"
and "compressedDepth" codecs of github.com/ros-perception/image_transport_plugins; the latter's
header is an int32 and the two floats A and B by which inverse depth was quantised: z = A / (v - B).
Depth of 16 bits is in millimetres, depth in floats in metres (REP 118).
"""

import struct
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.core.camera import MOST_SIDE_PX
from vnav.core.frame import Rejected
from vnav.errors import CaptureError
from vnav.io.formats.images import size_if_whole
from vnav.io.recordings.ros_messages import AnyImage, RosCompressedImage, RosImage

MILLIMETRES = 1000.0  # units a metre
FINE = 5000.0  # units a metre of depth that came in floats: steps of 0.2 mm, up to 13.1 m
_LARGEST = 65534  # of a stored depth; 65535 means none, too

_COLOR = {  # encoding -> channels, and how they become those that OpenCV writes
    "rgb8": (3, cv2.COLOR_RGB2BGR),
    "bgr8": (3, None),
    "rgba8": (4, cv2.COLOR_RGBA2BGR),
    "bgra8": (4, cv2.COLOR_BGRA2BGR),
    "mono8": (1, None),
}
_DEPTH: dict[str, np.dtype[Any]] = {"16UC1": np.dtype(np.uint16), "32FC1": np.dtype(np.float32)}
_FILES = ("jpeg", "jpg", "png")  # codecs whose data is a file as it is
_DEPTH_HEADER = struct.Struct("<iff")
_PNG_KIND = slice(24, 26)  # where a PNG tells its bits and its colour type
_GREY_16 = b"\x10\x00"


@dataclass(frozen=True)
class EncodedImage:
    """The bytes of an image file, and its width and height."""

    data: bytes
    suffix: str
    size: tuple[int, int]


def is_depth(image: AnyImage) -> bool:
    """Whether an image holds depth, by its encoding."""
    return image.encoding in _DEPTH or "compressedDepth" in getattr(image, "codec", "")


def is_color(image: AnyImage) -> bool:
    """Whether an image holds colours, not grey alone, in an encoding that can be read."""
    if isinstance(image, RosImage):
        return _COLOR.get(image.encoding, (1, None))[0] > 1
    return not is_depth(image) and _is_file(image) and image.encoding != "mono8"


def units_per_metre(depth: AnyImage) -> float:
    """What a depth image is divided by, once it is a file."""
    return FINE if depth.encoding == "32FC1" else MILLIMETRES


def color_file(image: AnyImage) -> EncodedImage | Rejected:
    """A colour or grey image as a file; Rejected where it is damaged.

    CaptureError where it is of an encoding that is not known: so are all of its topic.
    """
    if isinstance(image, RosCompressedImage):
        return _as_it_is(image)
    if image.encoding not in _COLOR:
        raise _unknown(image.encoding, _COLOR)
    channels, conversion = _COLOR[image.encoding]
    pixels = _pixels(image, np.dtype(np.uint8), channels)
    if isinstance(pixels, Rejected):
        return pixels
    return _png(pixels if conversion is None else cv2.cvtColor(pixels, conversion))


def depth_file(image: AnyImage, size: tuple[int, int]) -> EncodedImage | Rejected:
    """A depth image of 16 bits as a PNG file; otherwise as `color_file`.

    Depth in floats is stored in steps of 0.2 mm, and what lies beyond 13.1 m as none. A compressed
    image of floats is decoded only if it has ``size``.
    """
    if image.encoding not in _DEPTH:
        raise _unknown(image.encoding, _DEPTH)
    if isinstance(image, RosCompressedImage):
        return _compressed_depth(image, size)
    pixels = _pixels(image, _DEPTH[image.encoding], 1)
    if isinstance(pixels, Rejected):
        return pixels
    return _png(pixels) if pixels.dtype == np.uint16 else _fine(pixels)


def _as_it_is(image: RosCompressedImage) -> EncodedImage | Rejected:
    if not _is_file(image):
        raise _unknown(image.codec, _FILES)
    return _whole(image.data.tobytes())


def _compressed_depth(image: RosCompressedImage, size: tuple[int, int]) -> EncodedImage | Rejected:
    if not ("png" in image.codec or image.codec == "compressedDepth"):
        raise _unknown(image.codec, ("compressedDepth png", "png"))
    data, A, B = image.data.tobytes(), 0.0, 0.0
    if "compressedDepth" in image.codec:
        if len(data) < _DEPTH_HEADER.size:
            return Rejected(f"expected a header of compressedDepth, found {len(data)} bytes")
        _, A, B = _DEPTH_HEADER.unpack_from(data)
        data = data[_DEPTH_HEADER.size :]
    file = _whole(data)
    if isinstance(file, Rejected):
        return file
    if file.suffix != ".png" or data[_PNG_KIND] != _GREY_16:
        return Rejected("expected depth as a grey PNG of 16 bits, found another image")
    if image.encoding == "16UC1":
        return file
    if file.size != size:
        found = f"{file.size[0]} x {file.size[1]}"
        return Rejected(f"expected {size[0]} x {size[1]} pixels, found {found}")
    inverse = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if inverse is None:
        return Rejected("expected an image, found a file OpenCV cannot decode")
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        depth_m = np.float32(A) / (inverse.astype(np.float32) - np.float32(B))
    return _fine(np.where(inverse == 0, np.float32(np.nan), depth_m))


def _whole(data: bytes) -> EncodedImage | Rejected:
    try:
        size = size_if_whole(data, "the message")
    except CaptureError as error:
        return Rejected(str(error))
    if size is None:
        return Rejected("expected a JPEG or PNG file in the message, found neither")
    return EncodedImage(data, ".png" if data.startswith(b"\x89") else ".jpg", size)


def _pixels(image: RosImage, kind: np.dtype[Any], channels: int) -> NDArray[Any] | Rejected:
    """Pixels (H, W) or (H, W, channels) of a raw image."""
    width, height, row = image.width, image.height, image.width * channels * kind.itemsize
    if not 0 < min(width, height) <= max(width, height) <= MOST_SIDE_PX:
        return Rejected(f"expected an image, found {width} x {height} pixels")
    if image.step < row or image.step * height != len(image.data):
        return Rejected(
            f"expected {height} rows of at least {row} bytes for {width} x {height}"
            f" {image.encoding}, found {image.step} a row and {len(image.data)} in all"
        )
    rows = np.ascontiguousarray(image.data.reshape(height, image.step)[:, :row])
    stored = kind.newbyteorder(">" if image.is_bigendian else "<")
    pixels = rows.view(stored).astype(kind, copy=False)
    return pixels if channels == 1 else pixels.reshape(height, width, channels)


def _fine(depth_m: NDArray[np.float32]) -> EncodedImage:
    with np.errstate(invalid="ignore", over="ignore"):
        units = np.rint(depth_m * np.float64(FINE))
        units[~((units > 0) & (units <= _LARGEST))] = 0
    return _png(units.astype(np.uint16))


def _png(pixels: NDArray[np.generic]) -> EncodedImage:
    height, width = pixels.shape[:2]
    _, data = cv2.imencode(".png", pixels)
    return EncodedImage(data.tobytes(), ".png", (width, height))


def _is_file(image: RosCompressedImage) -> bool:
    return any(name in image.codec for name in _FILES)


def _unknown(found: str, known: Iterable[str]) -> CaptureError:
    return CaptureError(f"expected images encoded as one of {', '.join(known)}, found '{found}'")
