import os
import sys
from pathlib import Path

import cv2
import numpy as np
import pillow_heif
import pytest

from vnav.errors import PhotoError
from vnav.io.photos.heic import is_heic
from vnav.io.photos.photo_files import read_photo

HEAD = b"\0\0\0\x18ftypheic\0\0\0\0mif1heic"


@pytest.fixture
def broken(tmp_path: Path) -> Path:
    path = tmp_path / "photo.heic"
    path.write_bytes(HEAD)
    return path


def test_heic_is_told_by_its_content(broken: Path, tmp_path: Path) -> None:
    named = tmp_path / "a.heic"
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((4, 4, 3), np.uint8))
    (tmp_path / "a.png").rename(named)
    assert is_heic(broken)
    assert not is_heic(named)
    assert not is_heic(tmp_path / "missing.heic")
    assert read_photo(named).shape == (4, 4, 3)


def test_a_pipe_is_no_photo_and_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "photo.heic")
    with pytest.raises(PhotoError, match="no regular file"):
        read_photo(tmp_path / "photo.heic")


def test_without_the_library_what_to_install_is_told(
    broken: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pillow_heif", None)
    with pytest.raises(PhotoError, match=r"pip install vnav-rgbd\[heic\]"):
        read_photo(broken)


def test_a_broken_heic_photo_is_told(broken: Path) -> None:
    with pytest.raises(PhotoError, match="whole HEIC"):
        read_photo(broken)


def test_a_heic_photo_is_read(tmp_path: Path) -> None:
    image = np.zeros((64, 96, 3), np.uint8)
    image[:, 48:] = (250, 10, 20)
    path = tmp_path / "photo.heic"
    pillow_heif.from_bytes("RGB", (96, 64), image.tobytes()).save(path, quality=95)
    found = read_photo(path)
    assert found.shape == image.shape
    # A lossy codec: flat halves come back within a few grey levels.
    assert np.abs(found[:, 60:].astype(int) - image[:, 60:]).max() < 12


def test_a_heic_photo_of_an_unknown_version_is_told(tmp_path: Path) -> None:
    path = tmp_path / "photo.heic"
    pillow_heif.from_bytes("RGB", (96, 64), bytes(96 * 64 * 3)).save(path)
    path.write_bytes(path.read_bytes().replace(b"infe\x02", b"infe\x86"))
    with pytest.raises(PhotoError, match="whole HEIC .*version"):
        read_photo(path)
