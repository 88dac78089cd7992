"""What a photo's EXIF tells about its camera; see the Exif 2.32 standard (CIPA DC-008)."""

import struct
from dataclasses import dataclass
from pathlib import Path

from vnav.errors import PhotoError
from vnav.io.files import read_bytes
from vnav.io.photos.heic import EXIF_HEADER, heic_exif, is_heic

EXIF_IFD = 0x8769
FOCAL_MM, FOCAL_35MM = 0x920A, 0xA405
PLANE_X_RESOLUTION, PLANE_UNIT = 0xA20E, 0xA210
PIXEL_WIDTH, PIXEL_HEIGHT = 0xA002, 0xA003  # of the image as it left the camera
UNIT_MM = {2: 25.4, 3: 10.0, 4: 1.0}  # of the focal plane's resolution: inch, cm, mm
DIAGONAL_35MM = 43.267  # of a 36 x 24 mm frame, which "equivalent" refers to
TYPES = {1: "B", 3: "H", 4: "I", 5: "II"}  # byte, short, long, rational

Tags = dict[int, float]


@dataclass(frozen=True)
class Exif:
    """Numeric tags of the image and of its Exif directory; none where there is no EXIF."""

    tags: Tags

    def focal_px(self, width: int, height: int) -> float | None:
        """Focal length in pixels of the image at this size, None where EXIF does not tell.

        From the focal length and the sensor's pixel pitch, else from the 35 mm equivalent, taken
        over the diagonal.
        """
        tags, longest = self.tags, max(width, height)
        pitch = tags.get(PLANE_X_RESOLUTION, 0) / UNIT_MM.get(int(tags.get(PLANE_UNIT, 2)), 25.4)
        full = max(tags.get(PIXEL_WIDTH, 0), tags.get(PIXEL_HEIGHT, 0)) or longest
        if tags.get(FOCAL_MM, 0) > 0 and pitch > 0:
            return tags[FOCAL_MM] * pitch * longest / full
        if tags.get(FOCAL_35MM, 0) > 0:
            return float(tags[FOCAL_35MM] * (width**2 + height**2) ** 0.5 / DIAGONAL_35MM)
        return None


def read_exif(path: Path) -> Exif:
    """The EXIF of a JPEG or HEIC; empty for another format or file, none, and damaged EXIF."""
    try:
        tiff = heic_exif(path) if is_heic(path) else _tiff(read_bytes(path))
        return Exif(_tags(tiff) if tiff else {})
    except (PhotoError, OSError, struct.error, IndexError, KeyError, ZeroDivisionError):
        return Exif({})


def _tiff(data: bytes) -> bytes | None:
    """The TIFF block in a JPEG's APP1 segment."""
    at = 2
    if not data.startswith(b"\xff\xd8"):
        return None
    while data[at] == 0xFF and data[at + 1] != 0xDA:
        (length,) = struct.unpack_from(">H", data, at + 2)
        if data[at + 1] == 0xE1 and data[at + 4 : at + 10] == EXIF_HEADER:
            return data[at + 10 : at + 2 + length]
        at += 2 + length
    return None


def _tags(tiff: bytes) -> Tags:
    order = {b"II": "<", b"MM": ">"}[tiff[:2]]
    (first,) = struct.unpack_from(order + "I", tiff, 4)
    tags = _directory(tiff, first, order)
    if EXIF_IFD in tags:
        tags |= _directory(tiff, int(tags[EXIF_IFD]), order)
    return tags


def _directory(tiff: bytes, at: int, order: str) -> Tags:
    """The first value of every numeric tag of one directory."""
    (count,) = struct.unpack_from(order + "H", tiff, at)
    tags: Tags = {}
    for entry in range(at + 2, at + 2 + 12 * count, 12):
        tag, kind, _ = struct.unpack_from(order + "HHI", tiff, entry)
        if kind not in TYPES:
            continue
        place = entry + 8
        if kind == 5:  # too long for the entry, which tells where it is
            (place,) = struct.unpack_from(order + "I", tiff, place)
        value = struct.unpack_from(order + TYPES[kind], tiff, place)
        tags[tag] = value[0] / value[1] if kind == 5 else float(value[0])
    return tags
