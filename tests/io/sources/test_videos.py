"""Folders with a video of colour and one of depth, by a codec that loses nothing."""

from pathlib import Path

import numpy as np
import pytest

from tests.films import film
from vnav.config import CaptureConfig
from vnav.errors import CameraError, CaptureError
from vnav.io.sources.folder_capture import FolderCapture
from vnav.io.sources.open_capture import open_capture

FRAMES, WIDTH, HEIGHT, RATE_HZ = 6, 48, 32, 15.0
CAMERA = f"""
[color]
width = {WIDTH}
height = {HEIGHT}
fx = 40.0
fy = 40.0
cx = 23.5
cy = 15.5
[depth]
units_per_metre = 1000
"""


@pytest.fixture
def color() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (FRAMES, HEIGHT, WIDTH, 3), np.uint8)


@pytest.fixture
def depth() -> np.ndarray:
    """A slanted surface, a metre farther from frame to frame, which uses all bits."""
    ramp = 600 + np.arange(HEIGHT * WIDTH).reshape(HEIGHT, WIDTH)
    return (ramp + 1000 * np.arange(FRAMES)[:, None, None]).astype(np.uint16)


@pytest.fixture
def root(tmp_path: Path, color: np.ndarray, depth: np.ndarray) -> Path:
    film(tmp_path / "rgb.mkv", color, RATE_HZ)
    film(tmp_path / "depth.mkv", depth, RATE_HZ)
    (tmp_path / "camera.toml").write_text(CAMERA)
    return tmp_path


def opened(root: Path) -> FolderCapture:
    return open_capture(root, CaptureConfig())


def test_frames_have_both_images_of_their_number_and_the_videos_rate(
    root: Path, color: np.ndarray, depth: np.ndarray
) -> None:
    capture = opened(root)
    np.testing.assert_allclose(capture.stamps_s, np.arange(FRAMES) / RATE_HZ)
    for k in (0, 3, 1):
        frame = capture.read(k)
        np.testing.assert_array_equal(frame.color, color[k])
        np.testing.assert_array_equal(np.rint(frame.depth_m * 1000), depth[k])


def test_what_one_video_has_more_is_dropped_and_counted(root: Path, depth: np.ndarray) -> None:
    film(root / "depth.mkv", depth[:4], RATE_HZ)
    capture = opened(root)
    assert len(capture) == 4
    assert (len(capture.files.dropped_color), len(capture.files.dropped_depth)) == (2, 0)


def test_depth_of_eight_bits_is_refused_with_what_to_do(root: Path, depth: np.ndarray) -> None:
    film(root / "depth.mkv", (depth // 256).astype(np.uint8), RATE_HZ)
    with pytest.raises(CaptureError, match=r"16 bits.*depth.mkv.*uint8.*-pix_fmt gray16le"):
        opened(root)


def test_two_rates_are_refused(root: Path, depth: np.ndarray) -> None:
    film(root / "depth.mkv", depth, 30.0)
    with pytest.raises(CaptureError, match=r"one rate.*15 frames a second in rgb.mkv and 30"):
        opened(root)


def test_two_videos_of_colour_are_refused(root: Path, color: np.ndarray) -> None:
    film(root / "color.mkv", color, RATE_HZ)
    with pytest.raises(CaptureError, match=r"one video color.*color.mkv and rgb.mkv"):
        opened(root)


def test_a_video_that_is_cut_off_gives_its_first_frames(root: Path) -> None:
    whole = (root / "depth.mkv").read_bytes()
    (root / "depth.mkv").write_bytes(whole[: len(whole) * 2 // 3])
    capture = opened(root)
    assert capture.read(0).depth_m.all()
    with pytest.raises(CaptureError, match=r"expected frame 5 of the video .*depth.mkv"):
        capture.read(5)


def test_without_a_camera_one_of_the_videos_size_is_proposed(root: Path) -> None:
    (root / "camera.toml").unlink()
    with pytest.raises(CameraError) as error:
        opened(root)
    assert f"width = {WIDTH} " in error.value.__notes__[0]
