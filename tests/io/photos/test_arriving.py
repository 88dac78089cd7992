"""Photos that are being written are waited for, and each that comes into a folder is given once."""

import os
import threading
import time
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
import pytest

from vnav.errors import PhotoError
from vnav.io.photos import arriving
from vnav.io.photos.arriving import arriving_photos, wait_until_written

LONG_S = 30.0  # longer than any of these tests waits


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Looks follow each other at once; what has to settle does so in the tests of it alone."""
    monkeypatch.setattr(arriving, "POLL_S", 0.005)
    monkeypatch.setattr(arriving, "PATIENCE_S", LONG_S)
    monkeypatch.setattr(arriving, "SETTLED_S", LONG_S)


def encoded(grey: int, form: str = ".jpg") -> bytes:
    return cv2.imencode(form, np.full((24, 32, 3), grey, np.uint8))[1].tobytes()


def written(path: Path, grey: int = 0) -> Path:
    path.write_bytes(encoded(grey))
    return path


def names(photos: Iterator[Path], count: int) -> list[str]:
    return [path.name for path in islice(photos, count)]


def next_of(photos: Iterator[Path]) -> str:
    (name,) = names(photos, 1)
    return name


@pytest.mark.parametrize("form", [".jpg", ".png"])
def test_a_photo_that_is_being_written_is_waited_for(form: str, tmp_path: Path) -> None:
    path, content = tmp_path / f"photo{form}", encoded(7, form)
    path.write_bytes(content[:-1])
    waiting = threading.Thread(target=wait_until_written, args=[path])
    waiting.start()
    waiting.join(0.1)
    assert waiting.is_alive()
    path.write_bytes(content)
    waiting.join(LONG_S)
    assert not waiting.is_alive()


def test_a_whole_photo_and_a_name_without_a_file_are_not_waited_for(tmp_path: Path) -> None:
    started_s = time.monotonic()
    wait_until_written(written(tmp_path / "photo.jpg"))
    wait_until_written(tmp_path / "none.jpg")
    wait_until_written(tmp_path)
    assert time.monotonic() - started_s < LONG_S


@pytest.mark.parametrize(
    ("setting", "content"), [("PATIENCE_S", encoded(7)[:-9]), ("SETTLED_S", encoded(7, ".bmp"))]
)
def test_a_photo_that_nobody_goes_on_writing_is_taken_as_it_is(
    setting: str, content: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(arriving, setting, 0.2)
    path = tmp_path / "photo"
    path.write_bytes(content)
    os.utime(path, (2e9, 2e9))  # by a clock that is ahead
    started_s = time.monotonic()
    wait_until_written(path)
    assert 0.2 <= time.monotonic() - started_s < LONG_S


def test_photos_that_are_there_come_first_in_order_of_name(tmp_path: Path) -> None:
    for grey, name in enumerate(("b.jpg", "a.jpg", "c.jpg", "notes.txt", ".draft.jpg")):
        written(tmp_path / name, grey)
    photos = arriving_photos(tmp_path)
    assert names(photos, 3) == ["a.jpg", "b.jpg", "c.jpg"]
    written(tmp_path / "0.jpg", 9)
    assert next_of(photos) == "0.jpg"


def test_a_photo_that_is_renamed_into_its_place_is_given(tmp_path: Path) -> None:
    photos = arriving_photos(tmp_path)
    written(tmp_path / "photo.jpg.part").rename(tmp_path / "photo.jpg")
    assert next_of(photos) == "photo.jpg"


def test_a_photo_that_is_renamed_or_touched_is_not_given_again(tmp_path: Path) -> None:
    first, second = written(tmp_path / "first.jpg", 1), written(tmp_path / "second.jpg", 2)
    photos = arriving_photos(tmp_path)
    assert names(photos, 2) == ["first.jpg", "second.jpg"]
    first.rename(tmp_path / "renamed.jpg")
    os.utime(second, (1e9, 1e9))
    written(tmp_path / "third.jpg", 3)
    assert next_of(photos) == "third.jpg"


def test_another_photo_of_the_same_name_is_given(tmp_path: Path) -> None:
    photos = arriving_photos(tmp_path)
    written(tmp_path / "latest.jpg", 1)
    assert next_of(photos) == "latest.jpg"
    written(tmp_path / "latest.jpg", 2)
    assert next_of(photos) == "latest.jpg"


def test_one_that_is_being_written_does_not_hold_up_the_others(tmp_path: Path) -> None:
    (tmp_path / "a.jpg").write_bytes(encoded(1)[:-1])
    photos = arriving_photos(tmp_path)
    written(tmp_path / "b.jpg", 2)
    assert next_of(photos) == "b.jpg"
    written(tmp_path / "a.jpg", 1)
    assert next_of(photos) == "a.jpg"


def test_one_that_is_renamed_before_it_is_read_is_given_by_its_new_name(tmp_path: Path) -> None:
    photos = arriving_photos(tmp_path)
    early = written(tmp_path / "upload.jpg")
    assert next_of(photos) == "upload.jpg"
    early.rename(tmp_path / "photo.jpg")  # while whoever asked has not read it
    assert next_of(photos) == "photo.jpg"


def test_a_folder_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(PhotoError, match="expected a folder of photos at"):
        next(arriving_photos(tmp_path / "none"))
