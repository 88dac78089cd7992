"""Image files: whole or not at all.

OpenCV decodes a file that was cut off as far as it goes and fills up the rest, with no more than a
warning; so the file's structure is read first: a PNG's chunks and checksums, a JPEG's markers.
"""

import re
import struct
import zlib
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.errors import CaptureError
from vnav.io.files import read_bytes

_PNG, _JPEG = b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff"
_MARKER = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")  # neither stuffing nor a restart
_SOS, _EOI = 0xDA, 0xD9
_SOF = set(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}


def read_image(path: Path) -> NDArray[np.uint8]:
    """An image (H, W, 3) uint8, RGB; CaptureError where the file is missing, damaged or no image.

    An orientation in its EXIF is applied.
    """
    return image_of(_content(path), path)


def image_of(data: bytes, where: object) -> NDArray[np.uint8]:
    """The image that a file's bytes are, as `read_image`; ``where`` they come from is told."""
    bgr = _decoded(data, where, cv2.IMREAD_COLOR)
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), np.uint8)


def read_depth(path: Path) -> NDArray[np.uint16]:
    """A depth image (H, W) uint16 as stored; CaptureError also where it is of another kind."""
    depth = _decoded(_content(path), path, cv2.IMREAD_UNCHANGED)
    if depth.dtype != np.uint16 or depth.ndim != 2:
        channels = 1 if depth.ndim == 2 else depth.shape[2]
        raise CaptureError(
            f"expected 16-bit depth with one channel in {path}, found {depth.dtype} with"
            f" {channels}; write depth as 16-bit PNG"
        )
    return np.asarray(depth, np.uint16)


def read_gray(path: Path) -> NDArray[np.uint8]:
    """An image (H, W) uint8 of grey levels as stored; CaptureError as `read_image`."""
    return np.asarray(_decoded(_content(path), path, cv2.IMREAD_GRAYSCALE), np.uint8)


def image_size(path: Path) -> tuple[int, int]:
    """Width and height of an image, which is read whole but decoded only if neither PNG nor JPEG.

    CaptureError as `read_image`: a file that passes is whole.
    """
    data = _content(path)
    size = size_if_whole(data, path)
    if size is None:
        height, width = _decoded(data, path, cv2.IMREAD_UNCHANGED).shape[:2]
        return width, height
    return size


def first_size(paths: Iterable[Path]) -> tuple[int, int] | None:
    """Width and height of the first image that is whole, None where none is."""
    for path in paths:
        with suppress(CaptureError):
            return image_size(path)
    return None


def size_if_whole(data: bytes, where: object) -> tuple[int, int] | None:
    """Width and height of a PNG or JPEG; None for other formats, CaptureError if cut or altered.

    ``where`` the bytes come from is told.
    """
    try:
        if data.startswith(_PNG):
            return _png_size(data)
        if data.startswith(_JPEG):
            return _jpeg_size(data)
    except (struct.error, IndexError) as error:
        raise CaptureError(f"expected a whole image in {where}, found a truncated file") from error
    except ValueError as error:
        raise CaptureError(f"expected a whole image in {where}, found {error}") from error
    return None


def is_whole(path: Path) -> bool | None:
    """Whether a file is a whole image, as PNG and JPEG tell; None of another format.

    False also for an empty file, and for one that cannot be read.
    """
    try:
        data = _content(path)
        return bool(size_if_whole(data, path)) or (None if data else False)
    except CaptureError:
        return False


def _decoded(data: bytes, where: object, flags: int) -> NDArray[np.generic]:
    size_if_whole(data, where)
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), flags) if data else None
    except cv2.error:  # an image larger than OpenCV accepts
        image = None
    if image is None:
        raise CaptureError(f"expected an image in {where}, found a file OpenCV cannot decode")
    return np.asarray(image)


def _content(path: Path) -> bytes:
    try:
        return read_bytes(path)
    except OSError as error:
        raise CaptureError(f"expected an image at {path}, found: {error.strerror}") from error


def _png_size(data: bytes) -> tuple[int, int]:
    width, height = struct.unpack_from(">II", data, 16)
    view, at, kind = memoryview(data), len(_PNG), b""
    while kind != b"IEND":
        length, kind = struct.unpack_from(">I4s", data, at)
        (checksum,) = struct.unpack_from(">I", data, at + 8 + length)
        if zlib.crc32(view[at + 4 : at + 8 + length]) != checksum:
            raise ValueError("a PNG with a wrong checksum")
        at += 12 + length
    return width, height


def _jpeg_size(data: bytes) -> tuple[int, int]:
    size, at = None, 2
    while match := _MARKER.search(data, at):
        marker, at = data[match.end() - 1], match.end()
        if marker == _EOI:
            break
        if marker in _SOF:
            height, width = struct.unpack_from(">HH", data, at + 3)
            size = width, height
        (length,) = struct.unpack_from(">H", data, at)
        at += length
    else:
        raise ValueError("a truncated JPEG")
    if size is None:
        raise ValueError("a JPEG without a size")
    return size
