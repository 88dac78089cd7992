import struct
from pathlib import Path

import pillow_heif
import pytest

from vnav.io.photos.exif import read_exif

SHORT, LONG, RATIONAL = 3, 4, 5
Entry = tuple[int, int, tuple[int, ...]]


def jpeg_with(order: str, image: list[Entry], exif: list[Entry]) -> bytes:
    """A JPEG's head with an EXIF block: tag, type, values in the image's and the Exif directory."""
    start = 8
    exif_at = start + 2 + 12 * (len(image) + 1) + 4
    data_at = exif_at + 2 + 12 * len(exif) + 4
    head, tail = b"", b""
    for entries in ([*image, (0x8769, LONG, (exif_at,))], exif):
        head += struct.pack(order + "H", len(entries))
        for tag, kind, values in entries:
            head += struct.pack(order + "HHI", tag, kind, 1)
            if kind == RATIONAL:
                head += struct.pack(order + "I", data_at + len(tail))
                tail += struct.pack(order + "II", *values)
            elif kind == SHORT:
                head += struct.pack(order + "HH", *values, 0)
            else:
                head += struct.pack(order + "I", *values)
        head += struct.pack(order + "I", 0)
    mark = b"II" if order == "<" else b"MM"
    tiff = mark + struct.pack(order + "HI", 42, start) + head + tail
    block = b"Exif\0\0" + tiff
    return b"\xff\xd8\xff\xe1" + struct.pack(">H", len(block) + 2) + block + b"\xff\xda"


@pytest.mark.parametrize("order", ["<", ">"])
def test_the_35_mm_equivalent_gives_the_focal_length_over_the_diagonal(
    tmp_path: Path, order: str
) -> None:
    path = tmp_path / "photo.jpg"
    path.write_bytes(jpeg_with(order, [], [(0xA405, SHORT, (26,))]))
    # 26 mm before a diagonal of 43.27 mm; 4000 x 3000 pixels have a diagonal of 5000.
    assert read_exif(path).focal_px(4000, 3000) == pytest.approx(26 / 43.267 * 5000)


def test_the_pixel_pitch_is_preferred(tmp_path: Path) -> None:
    """5 mm before 2500 pixels per centimetre: 1250 pixels of the full image."""
    exif = [
        (0x920A, RATIONAL, (50, 10)),
        (0xA405, SHORT, (26,)),
        (0xA20E, RATIONAL, (2500, 1)),
        (0xA210, SHORT, (3,)),
        (0xA002, LONG, (4000,)),
        (0xA003, LONG, (3000,)),
    ]
    path = tmp_path / "photo.jpg"
    path.write_bytes(jpeg_with("<", [], exif))
    assert read_exif(path).focal_px(4000, 3000) == pytest.approx(1250)
    assert read_exif(path).focal_px(1500, 2000) == pytest.approx(625)  # halved, on its side


def test_a_photo_that_tells_no_focal_length_has_none(tmp_path: Path) -> None:
    path = tmp_path / "photo.jpg"
    path.write_bytes(jpeg_with("<", [(0x0112, SHORT, (6,))], [(0xA405, SHORT, (0,))]))
    assert read_exif(path).focal_px(640, 480) is None


@pytest.mark.parametrize("content", [b"", b"\x89PNG\r\n", b"\xff\xd8\xff\xe1\x00\x10Exif\0\0II*"])
def test_no_exif_and_damaged_exif_tell_nothing(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "photo"
    path.write_bytes(content)
    assert read_exif(path).tags == {}


def test_a_heic_file_tells_its_focal_length(tmp_path: Path) -> None:
    tiff = jpeg_with("<", [], [(0xA405, SHORT, (26,))]).partition(b"Exif\0\0")[2][:-2]
    path = tmp_path / "photo.heic"
    image = pillow_heif.from_bytes("RGB", (64, 48), bytes(64 * 48 * 3))
    image.info["exif"] = b"Exif\0\0" + tiff
    image.save(path)
    assert read_exif(path).focal_px(4000, 3000) == pytest.approx(26 / 43.267 * 5000)


def test_a_heic_file_without_exif_tells_nothing(tmp_path: Path) -> None:
    path = tmp_path / "photo.heic"
    pillow_heif.from_bytes("RGB", (64, 48), bytes(64 * 48 * 3)).save(path)
    assert read_exif(path).focal_px(4000, 3000) is None
