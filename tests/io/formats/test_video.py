import pickle
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.films import film
from vnav.errors import CaptureError
from vnav.io.formats.video import Video, frame_count, video_size

FRAMES, SIZE = 40, (48, 32)


@pytest.fixture
def images() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (FRAMES, *SIZE[::-1], 3), np.uint8)


@pytest.fixture
def path(tmp_path: Path, images: np.ndarray) -> Path:
    """A video in a codec that loses nothing."""
    film(tmp_path / "a.mp4", images)
    return tmp_path / "a.mp4"


def test_each_frame_is_the_one_of_its_number_in_any_order(path: Path, images: np.ndarray) -> None:
    video = Video(path)
    for number in (0, 1, 7, 3, 39, 0):
        np.testing.assert_array_equal(video.read(number), images[number])


def test_threads_get_their_frames_in_one_pass(
    path: Path, images: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = []

    def counted(*arguments: object) -> cv2.VideoCapture:
        opened.append(arguments)
        return original(*arguments)

    original = cv2.VideoCapture
    monkeypatch.setattr("vnav.io.formats.video.cv2.VideoCapture", counted)
    video = Video(path)
    video.read(0)
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(video.read, range(FRAMES)))
    np.testing.assert_array_equal(found, images)
    assert len(opened) < FRAMES / 4  # each thread out of turn would begin anew


def test_size_and_count_are_told(path: Path) -> None:
    assert video_size(path) == SIZE
    assert frame_count(path) == FRAMES


def test_a_frame_beyond_the_end_is_told_and_those_before_are_read(
    path: Path, images: np.ndarray
) -> None:
    video = Video(path)
    with pytest.raises(CaptureError, match=rf"frame 99 of the video {path}, found {FRAMES}"):
        video.read(99)
    np.testing.assert_array_equal(video.read(5), images[5])


def test_another_process_opens_the_video_itself(path: Path, images: np.ndarray) -> None:
    video = Video(path)
    video.read(3)
    again = pickle.loads(pickle.dumps(video))
    np.testing.assert_array_equal(again.read(2), images[2])


@pytest.mark.parametrize("content", [None, b"", b"no video"])
def test_what_is_no_video_is_told(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "rgb.mp4"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(CaptureError, match=r"expected a video .*rgb.mp4"):
        Video(path).read(0)
