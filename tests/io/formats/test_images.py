from pathlib import Path

import cv2
import numpy as np
import pytest

from vnav.errors import CaptureError
from vnav.io.formats.images import image_size, read_depth, read_image

RNG = np.random.default_rng(5)
NOISE = RNG.integers(0, 256, (48, 64, 3), np.uint8)
DEPTH = RNG.integers(0, 65536, (48, 64), np.uint16)


def encoded(extension: str, image: np.ndarray, *parameters: int) -> bytes:
    return cv2.imencode(extension, image, parameters)[1].tobytes()


KINDS = {
    "png": encoded(".png", NOISE),
    "depth png": encoded(".png", DEPTH),
    "jpeg": encoded(".jpg", NOISE),
    "progressive jpeg": encoded(".jpg", NOISE, cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
    "jpeg with restarts": encoded(".jpg", NOISE, cv2.IMWRITE_JPEG_RST_INTERVAL, 1),
}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "image"


def test_colour_is_red_green_blue(path: Path) -> None:
    path.write_bytes(encoded(".png", NOISE[..., ::-1]))
    np.testing.assert_array_equal(read_image(path), NOISE)


def test_depth_is_as_stored(path: Path) -> None:
    path.write_bytes(KINDS["depth png"])
    np.testing.assert_array_equal(read_depth(path), DEPTH)


@pytest.mark.parametrize(("bits", "channels"), [(8, 1), (8, 3), (16, 3)])
def test_depth_of_another_kind_is_refused(path: Path, bits: int, channels: int) -> None:
    shape = (48, 64) if channels == 1 else (48, 64, channels)
    path.write_bytes(encoded(".png", np.ones(shape, f"uint{bits}")))
    with pytest.raises(CaptureError, match=f"16-bit .*found uint{bits} with {channels}"):
        read_depth(path)


@pytest.mark.parametrize("kind", KINDS)
def test_sizes_come_from_the_header(path: Path, kind: str) -> None:
    path.write_bytes(KINDS[kind])
    assert image_size(path) == (64, 48)


def test_other_formats_are_decoded_for_their_size(path: Path) -> None:
    path.write_bytes(encoded(".bmp", NOISE))
    assert image_size(path) == (64, 48)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("share", [0.02, 0.3, 0.7, 0.99])
def test_a_file_that_was_cut_off_is_named(path: Path, kind: str, share: float) -> None:
    data = KINDS[kind]
    path.write_bytes(data[: int(len(data) * share)])
    for read in (image_size, read_image):
        with pytest.raises(CaptureError, match=str(path)):
            read(path)


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_whose_end_is_zeros_is_named(path: Path, kind: str) -> None:
    """What a crash leaves of a file that the system had already made as long as it would be."""
    data, half = KINDS[kind], len(KINDS[kind]) // 2
    path.write_bytes(data[:half] + bytes(len(data) - half))
    with pytest.raises(CaptureError, match=str(path)):
        read_image(path)


def test_a_thumbnail_that_is_whole_does_not_hide_that_its_jpeg_is_not(path: Path) -> None:
    data = KINDS["jpeg"]
    thumbnail = b"\xff\xe1" + (2 + len(data)).to_bytes(2, "big") + data
    whole = data[:2] + thumbnail + data[2:]
    path.write_bytes(whole)
    assert image_size(path) == (64, 48)
    path.write_bytes(whole[:-100])
    with pytest.raises(CaptureError, match="truncated"):
        image_size(path)


def test_a_png_with_one_byte_altered_is_named(path: Path) -> None:
    data = bytearray(KINDS["depth png"])
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    with pytest.raises(CaptureError, match="wrong checksum"):
        read_depth(path)


def test_bytes_after_the_end_do_no_harm(path: Path) -> None:
    for kind in KINDS:
        path.write_bytes(KINDS[kind] + bytes(100))
        assert image_size(path) == (64, 48)


@pytest.mark.parametrize("content", [b"", b"no image", b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff"])
def test_what_is_no_image_is_named(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    for read in (image_size, read_image, read_depth):
        with pytest.raises(CaptureError, match=str(path)):
            read(path)


def test_a_missing_file_is_named(path: Path) -> None:
    with pytest.raises(CaptureError, match=f"expected an image at {path}"):
        read_image(path)


def test_a_jpeg_of_nothing_but_fill_bytes_is_refused_without_asking_each_again(path: Path) -> None:
    """Were each fill byte the start of a search to the end, a file of 8 MB would take weeks."""
    path.write_bytes(b"\xff\xd8" + b"\xff" * 8_000_000)
    with pytest.raises(CaptureError, match="truncated"):
        image_size(path)
