"""Images of messages become files that hold the same pixels, or are told why not."""

import struct
from dataclasses import replace

import cv2
import numpy as np
import pytest

from vnav.core.frame import Rejected
from vnav.errors import CaptureError
from vnav.io.recordings.ros_images import EncodedImage, color_file, depth_file, units_per_metre
from vnav.io.recordings.ros_messages import RosCompressedImage, RosImage

WIDTH, HEIGHT = 5, 3
RNG = np.random.default_rng(0)
RGB = RNG.integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
ALPHA = RNG.integers(0, 256, (HEIGHT, WIDTH, 1), np.uint8)
MILLIMETRES = RNG.integers(300, 65536, (HEIGHT, WIDTH)).astype(np.uint16)


def raw(encoding: str, pixels: np.ndarray, *, is_bigendian: bool = False) -> RosImage:
    data = np.frombuffer(pixels.tobytes(), np.uint8)
    height, width = pixels.shape[:2]
    step = len(data) // height
    return RosImage(0, "frame", encoding, width, height, step, is_bigendian, data)


def packed(encoding: str, codec: str, data: bytes) -> RosCompressedImage:
    return RosCompressedImage(0, "frame", encoding, codec, np.frombuffer(data, np.uint8))


def png(pixels: np.ndarray) -> bytes:
    return cv2.imencode(".png", pixels)[1].tobytes()


def decoded(file: EncodedImage | Rejected, flags: int = cv2.IMREAD_UNCHANGED) -> np.ndarray:
    assert isinstance(file, EncodedImage), file
    image = cv2.imdecode(np.frombuffer(file.data, np.uint8), flags)
    assert file.size == image.shape[1::-1]
    return image


def depth_of(image: RosImage | RosCompressedImage) -> np.ndarray:
    return decoded(depth_file(image, (WIDTH, HEIGHT)))


@pytest.mark.parametrize(
    ("encoding", "pixels"),
    [
        ("rgb8", RGB),
        ("bgr8", RGB[..., ::-1]),
        ("rgba8", np.concatenate([RGB, ALPHA], 2)),
        ("bgra8", np.concatenate([RGB[..., ::-1], ALPHA], 2)),
    ],
)
def test_raw_colour_is_the_same_in_the_file(encoding: str, pixels: np.ndarray) -> None:
    assert (decoded(color_file(raw(encoding, pixels)))[..., ::-1] == RGB).all()


def test_grey_is_read_as_three_equal_channels() -> None:
    file = color_file(raw("mono8", RGB[..., 0]))
    assert (decoded(file, cv2.IMREAD_COLOR) == RGB[..., :1]).all()


def test_bytes_at_the_end_of_rows_are_left_out() -> None:
    padded = np.concatenate([RGB, RGB[:, :2]], 1)
    image = replace(raw("rgb8", padded), width=WIDTH)
    assert (decoded(color_file(image))[..., ::-1] == RGB).all()


@pytest.mark.parametrize(("codec", "suffix"), [("jpeg compressed bgr8", ".jpg"), ("png", ".png")])
def test_compressed_colour_stays_the_bytes_that_it_was(codec: str, suffix: str) -> None:
    data = cv2.imencode(suffix, RGB)[1].tobytes()
    assert color_file(packed("rgb8", codec, data)) == EncodedImage(data, suffix, (WIDTH, HEIGHT))


@pytest.mark.parametrize("is_bigendian", [False, True])
def test_depth_of_16_bits_is_the_same_in_the_file(is_bigendian: bool) -> None:
    stored = MILLIMETRES.astype(">u2" if is_bigendian else "<u2")
    image = raw("16UC1", stored, is_bigendian=is_bigendian)
    assert (depth_of(image) == MILLIMETRES).all()
    assert units_per_metre(image) == 1000


def test_depth_in_floats_is_stored_in_steps_of_a_fifth_of_a_millimetre() -> None:
    depth_m = np.linspace(0.3, 13.1, WIDTH * HEIGHT, dtype=np.float32).reshape(HEIGHT, WIDTH)
    image = raw("32FC1", depth_m)
    assert units_per_metre(image) == 5000
    # Rounded to whole units: half of one at most, and what float32 rounds at 13 m, 1e-6 m.
    assert np.abs(depth_of(image) / 5000 - depth_m).max() <= 0.0001 + 1e-6


def test_what_is_no_depth_in_floats_is_stored_as_none() -> None:
    none = [np.nan, np.inf, -np.inf, -1.0, 0.0, 13.2, 1e30]
    depth_m = np.array([[1.0, *none]], np.float32)
    assert depth_of(raw("32FC1", depth_m)).tolist() == [[5000, *[0] * len(none)]]


@pytest.mark.parametrize("codec", ["compressedDepth", "compressedDepth png"])
def test_compressed_depth_of_16_bits_stays_the_bytes_that_it_was(codec: str) -> None:
    data = png(MILLIMETRES)
    image = packed("16UC1", codec, struct.pack("<iff", 0, 0.0, 0.0) + data)
    assert depth_file(image, (WIDTH, HEIGHT)) == EncodedImage(data, ".png", (WIDTH, HEIGHT))


def test_depth_behind_no_header_is_a_png_as_it_is() -> None:
    data = png(MILLIMETRES)
    assert depth_file(packed("16UC1", "png compressed", data), (WIDTH, HEIGHT)) == EncodedImage(
        data, ".png", (WIDTH, HEIGHT)
    )


def test_compressed_depth_in_floats_is_what_was_quantised() -> None:
    # As compressed_depth_image_transport does by its defaults: up to 10 m, quantisation 100.
    A = 100.0 * 101.0
    B = 1.0 - A / 10.0
    depth_m = np.linspace(0.5, 9.5, WIDTH * HEIGHT).reshape(HEIGHT, WIDTH)
    inverse = (A / depth_m + B).astype(np.uint16)
    inverse[0, 0] = 0
    image = packed("32FC1", "compressedDepth png", struct.pack("<iff", 1, A, B) + png(inverse))
    found_m = depth_of(image) / 5000
    assert found_m[0, 0] == 0
    # One step of inverse depth is z^2 / A metres, and a step of the file 0.2 mm.
    off_m = np.abs(found_m - depth_m).ravel()[1:]
    assert (off_m <= depth_m.ravel()[1:] ** 2 / A * 1.01 + 0.0002).all()


@pytest.mark.parametrize(
    "image",
    [
        replace(raw("rgb8", RGB), width=WIDTH + 1),
        replace(raw("rgb8", RGB), height=HEIGHT + 1),
        replace(raw("rgb8", RGB), step=WIDTH * 3 + 1),
        replace(raw("rgb8", RGB), width=2**32 - 1, height=2**32 - 1),
        replace(raw("rgb8", RGB), width=0),
        replace(raw("rgb8", RGB), height=0, data=RGB.ravel()[:0]),
        packed("rgb8", "jpeg compressed bgr8", cv2.imencode(".jpg", RGB)[1].tobytes()[:-40]),
        packed("rgb8", "jpeg compressed bgr8", b""),
        packed("", "png", b"neither of them"),
    ],
)
def test_a_damaged_colour_image_is_told(image: RosImage | RosCompressedImage) -> None:
    file = color_file(image)
    assert isinstance(file, Rejected)
    assert file.reason.startswith("expected ")


@pytest.mark.parametrize(
    "data",
    [
        b"short",
        bytes(12),
        bytes(12) + png(MILLIMETRES)[:-20],
        bytes(12) + png(RGB),
        bytes(12) + cv2.imencode(".jpg", RGB)[1].tobytes(),
    ],
)
@pytest.mark.parametrize("encoding", ["16UC1", "32FC1"])
def test_damaged_compressed_depth_is_told(encoding: str, data: bytes) -> None:
    file = depth_file(packed(encoding, "compressedDepth png", data), (WIDTH, HEIGHT))
    assert isinstance(file, Rejected)
    assert file.reason.startswith("expected ")


def test_floats_of_another_size_are_not_decoded() -> None:
    data = bytes(12) + png(MILLIMETRES)
    file = depth_file(packed("32FC1", "compressedDepth png", data), (WIDTH, HEIGHT + 1))
    assert isinstance(file, Rejected)
    assert "expected 5 x 4 pixels, found 5 x 3" in file.reason


@pytest.mark.parametrize(
    "image", [raw("bayer_rggb8", RGB[..., 0]), packed("", "h264", b""), packed("rgb8", "avif", b"")]
)
def test_an_unknown_encoding_of_colour_is_an_error(image: RosImage | RosCompressedImage) -> None:
    with pytest.raises(CaptureError, match="encoded as one of .*found '(bayer_rggb8|h264|avif)'"):
        color_file(image)


@pytest.mark.parametrize(
    "image", [raw("rgb8", RGB), packed("16UC1", "compressedDepth rvl", b""), packed("", "png", b"")]
)
def test_an_unknown_encoding_of_depth_is_an_error(image: RosImage | RosCompressedImage) -> None:
    with pytest.raises(CaptureError, match="encoded as one of"):
        depth_file(image, (WIDTH, HEIGHT))
