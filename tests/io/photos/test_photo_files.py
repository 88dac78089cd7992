from pathlib import Path

import cv2
import numpy as np
import pytest

from vnav.core.camera import Intrinsics
from vnav.errors import CameraError, PhotoError
from vnav.io.photos.photo_files import (
    CENTRE_SIGMA,
    DISTORTION_SIGMA,
    EXIF_SIGMA,
    find_photos,
    photo_camera,
    read_photo,
)

OF_MAP = Intrinsics(640, 480, 500.0, 501.0, 320.0, 240.0)
CAMERA = "[color]\nwidth = 640\nheight = 480\nfx = 600\nfy = 600\ncx = 319.5\ncy = 239.5\n"


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    path = tmp_path / "photo.png"
    cv2.imwrite(str(path), np.zeros((480, 640, 3), np.uint8))
    return path


def test_a_grey_photo_gets_three_channels(tmp_path: Path) -> None:
    path = tmp_path / "grey.png"
    cv2.imwrite(str(path), np.full((4, 6), 9, np.uint8))
    assert read_photo(path).tolist() == np.full((4, 6, 3), 9).tolist()


@pytest.mark.parametrize("name", ["missing.jpg", 300 * "x"])
def test_a_photo_that_is_not_there_is_not_to_be_converted(tmp_path: Path, name: str) -> None:
    with pytest.raises(PhotoError, match="; name another$"):
        read_photo(tmp_path / name)


@pytest.mark.parametrize("content", [b"", b"no image at all"])
def test_what_is_no_image_is_told(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "photo.heic"
    path.write_bytes(content)
    with pytest.raises(PhotoError, match="photo.heic.*JPEG, PNG or HEIC"):
        read_photo(path)


def test_a_missing_photo_is_told(tmp_path: Path) -> None:
    with pytest.raises(PhotoError, match="nowhere.jpg"):
        read_photo(tmp_path / "nowhere.jpg")


def test_a_folder_stands_for_its_images_in_order(tmp_path: Path) -> None:
    for name in ("b.JPG", "a.png", "camera.toml", "groundtruth.txt"):
        (tmp_path / name).touch()
    single = tmp_path / "single.dat"
    found = find_photos([tmp_path, single])
    assert [path.name for path in found] == ["a.png", "b.JPG", "single.dat"]


def test_a_folder_without_images_is_told(tmp_path: Path) -> None:
    with pytest.raises(PhotoError, match="none"):
        find_photos([tmp_path])


def test_a_named_camera_may_be_the_file_of_another_tool(photo: Path, tmp_path: Path) -> None:
    named = tmp_path / "cameras.txt"
    named.write_text("1 SIMPLE_PINHOLE 640 480 600 320 240\n")
    camera = photo_camera(photo, (640, 480), named, OF_MAP)
    assert camera.intrinsics == Intrinsics(640, 480, 600.0, 600.0, 319.5, 239.5)


def test_the_named_camera_comes_first(photo: Path, tmp_path: Path) -> None:
    (photo.parent / "camera.toml").write_text(CAMERA)
    named = tmp_path / "named.toml"
    named.write_text(CAMERA.replace("600", "700"))
    camera = photo_camera(photo, (640, 480), named, OF_MAP)
    assert (camera.intrinsics.fx, camera.source, camera.prior.focal_sigma) == (700, "file", 0)


def test_then_the_camera_beside_the_photo(photo: Path) -> None:
    (photo.parent / "camera.toml").write_text(CAMERA)
    camera = photo_camera(photo, (640, 480), None, OF_MAP)
    assert (camera.intrinsics.fx, camera.source) == (600, "file")


def test_then_exif(photo: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from vnav.io.photos.exif import Exif

    monkeypatch.setattr("vnav.io.photos.photo_files.read_exif", lambda path: Exif({0xA405: 43.267}))
    camera = photo_camera(photo, (640, 480), None, OF_MAP)
    assert camera.intrinsics.fx == pytest.approx(800)
    assert (camera.source, camera.prior.focal_sigma) == ("exif", EXIF_SIGMA)


def test_then_the_maps_camera_where_the_size_is_the_same(photo: Path) -> None:
    camera = photo_camera(photo, (640, 480), None, OF_MAP)
    assert (camera.intrinsics, camera.source) == (OF_MAP, "assumed")


def test_else_the_focal_length_is_not_known(photo: Path) -> None:
    camera = photo_camera(photo, (1280, 960), None, OF_MAP)
    assert (camera.source, camera.prior.focal_sigma) == ("estimated", float("inf"))
    assert (camera.intrinsics.cx, camera.intrinsics.cy) == (639.5, 479.5)


@pytest.mark.parametrize("camera", ["auto", None])
def test_what_is_not_told_of_a_camera_is_known_roughly(photo: Path, camera: str | None) -> None:
    """Its image may have been cropped, and its lens may bend."""
    found = photo_camera(photo, (1280, 960), camera, OF_MAP).prior
    assert (found.centre_sigma, found.distortion_sigma) == (CENTRE_SIGMA, DISTORTION_SIGMA)


def test_a_camera_that_is_named_is_exact(photo: Path, tmp_path: Path) -> None:
    named = tmp_path / "named.toml"
    named.write_text(CAMERA)
    assert photo_camera(photo, (640, 480), named, OF_MAP).prior.is_exact
    assert photo_camera(photo, (640, 480), None, OF_MAP).prior.is_exact


def test_auto_overrides_the_camera_beside_the_photo(photo: Path) -> None:
    (photo.parent / "camera.toml").write_text(CAMERA)
    assert photo_camera(photo, (640, 480), "auto", OF_MAP).source == "estimated"


def test_a_camera_of_the_same_shape_is_scaled(photo: Path, tmp_path: Path) -> None:
    named = tmp_path / "named.toml"
    named.write_text(CAMERA)
    assert photo_camera(photo, (320, 240), named, OF_MAP).intrinsics.fx == pytest.approx(300)


def test_a_camera_of_another_shape_is_told(photo: Path, tmp_path: Path) -> None:
    named = tmp_path / "named.toml"
    named.write_text(CAMERA)
    with pytest.raises(CameraError, match=r"480 x 640.*640 x 480.*--camera auto"):
        photo_camera(photo, (480, 640), named, OF_MAP)
