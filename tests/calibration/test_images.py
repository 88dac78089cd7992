"""From a folder of photos to a camera.toml, by the API and by the command."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.calibration.board_photos import CAMERA, pose, write_photos
from vnav.api.calibrating import calibrate
from vnav.calibration import images
from vnav.calibration.board import Board
from vnav.calibration.estimate import FittedCamera
from vnav.core.camera import Camera
from vnav.errors import CameraError, CaptureError, PhotoError, VnavError
from vnav.io.formats.camera_file import read_camera, read_color

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def photos(board_photos: Path, tmp_path: Path) -> Path:
    """A copy of the photos that a test may spoil."""
    return Path(shutil.copytree(board_photos, tmp_path / "photos"))


def require_right(camera: FittedCamera) -> None:
    """Within four standard deviations, which are below a percent."""
    found = camera.intrinsics
    off = np.subtract(
        (found.fx, found.fy, found.cx, found.cy), (CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy)
    )
    assert (np.abs(off) < 4 * camera.sigmas[:4]).all()
    assert camera.sigmas[:4].max() < 5
    off_lens = np.subtract(found.distortion, CAMERA.distortion)
    assert (np.abs(off_lens) <= 4 * camera.sigmas[4:]).all()


def test_the_camera_of_the_photos_is_found(board_photos: Path) -> None:
    found = calibrate(board_photos)
    require_right(found.camera)
    assert len(found.camera.fitted) == 12
    assert found.left_out == {}
    assert found.warnings == ()


def test_the_camera_is_written_as_it_is_read(photos: Path) -> None:
    file = photos / "camera.toml"
    found = calibrate(photos, out=file)
    assert read_color(file) == found.camera.intrinsics
    assert "# By vnav calibrate, from 12 of 12 images" in file.read_text()
    calibrate(photos, out=file, units_per_metre=1000, force=True)
    assert read_camera(file) == Camera(found.camera.intrinsics, 1000)


def test_a_camera_that_is_there_is_not_replaced_unasked(photos: Path) -> None:
    file = photos / "camera.toml"
    file.write_text("mine")
    with pytest.raises(CameraError, match="found one, and left it as it is.*--out.*--force"):
        calibrate(photos, out=file)
    assert file.read_text() == "mine"


def test_images_that_do_not_serve_are_left_out_with_the_reason(photos: Path) -> None:
    sharp = cv2.imread(str(photos / "03.png"))
    (photos / "00.png").write_bytes((photos / "00.png").read_bytes()[:-20])
    cv2.imwrite(str(photos / "01.png"), np.full_like(sharp, 128))
    cv2.imwrite(str(photos / "02.png"), cv2.resize(sharp, (800, 600)))
    columns, rows = np.meshgrid(np.arange(640.0), np.arange(480.0))
    bent = (columns + 3 * np.sin(rows / 30)).astype(np.float32), rows.astype(np.float32)
    cv2.imwrite(str(photos / "03.png"), cv2.remap(sharp, *bent, cv2.INTER_LINEAR))
    found = calibrate(photos)
    assert sorted(found.left_out) == [f"0{k}.png" for k in range(4)]
    assert "truncated file" in found.left_out["00.png"]
    assert found.left_out["01.png"] == "no board found"
    assert found.left_out["02.png"] == "800 x 600 pixels, where most have 640 x 480"
    assert found.left_out["03.png"].startswith("outlier: its corners are ")
    require_right(found.camera)


def test_too_few_boards_are_an_error_that_tells_why(photos: Path) -> None:
    for k in range(3, 12):
        (photos / f"{k:02d}.png").write_bytes(b"none")
    said = r"found it in 0 of 12 \(3 times no board found; 1 times expected .*\).*not corners"
    with pytest.raises(CameraError, match=said):
        calibrate(photos, Board(dictionary="7X7_50"))


def test_boards_that_are_never_tilted_give_no_camera(tmp_path: Path) -> None:
    flat = [pose(Board(), (0, 0), (x, 0, 0.45)) for x in (-0.05, 0, 0.05)]
    with pytest.raises(CameraError, match=r"determine a focal length, found \d+ \+- .*tilt it by"):
        calibrate(write_photos(tmp_path, Board(), flat))


def test_a_folder_without_images_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(CaptureError, match="expected images of a board in"):
        calibrate(tmp_path)
    with pytest.raises(PhotoError, match="expected a folder of photos"):
        calibrate(tmp_path / "none")


def test_the_colour_images_of_a_capture_are_taken(tmp_path: Path) -> None:
    for name in ("color/2.jpg", "color/1.jpg", "depth/1.png", "depth/2.png"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    colors = images.board_images(tmp_path)
    assert [str(path.relative_to(tmp_path)) for path in colors] == ["color/1.jpg", "color/2.jpg"]


def test_of_a_long_recording_the_sharpest_images_are_used(
    board_photos: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    edges = {each.view.path: each.view.edge_px for each in calibrate(board_photos).camera.fitted}
    monkeypatch.setattr(images, "MOST_IMAGES", 6)
    found = calibrate(board_photos)
    pairs = np.array(sorted(edges)).reshape(6, 2)
    assert [each.view.path for each in found.camera.fitted] == [
        min(pair, key=edges.__getitem__) for pair in pairs.tolist()
    ]
    assert set(found.left_out.values()) == {"not needed: 6 images are enough"}


def test_the_picture_shows_corners_and_residuals(board_photos: Path, tmp_path: Path) -> None:
    calibrate(board_photos, picture=tmp_path / "found.png")
    picture = cv2.imread(str(tmp_path / "found.png")).astype(int)
    for color in ((246, 181, 100), (40, 40, 198), (0, 214, 255)):  # BGR: corner, residual, line
        assert (np.abs(picture - color).max(2) < 12).sum() > 100
    with pytest.raises(VnavError, match="expected to write .*/none/found.png.*--png"):
        calibrate(board_photos, picture=tmp_path / "none" / "found.png")


def test_the_command_writes_beside_the_images_and_tells_how_good_it_is(
    vnav: Run, photos: Path
) -> None:
    cv2.imwrite(str(photos / "grey.png"), np.full((480, 640), 128, np.uint8))
    code, out, err = vnav("calibrate", photos)
    assert code == 0
    assert "left out 1: no board found (grey.png)" in out
    assert "images   12 of 13 used, 640 x 480" in out
    assert "off      RMS 0." in out
    assert "pinhole  fx 52" in out
    assert read_color(photos / "camera.toml").size == (640, 480)
    assert vnav("calibrate", photos)[0] == 1


def test_the_command_prints_one_json_object(vnav: Run, photos: Path) -> None:
    code, out, _ = vnav("calibrate", photos, "--json", "--out", photos / "mine.toml")
    found = json.loads(out)
    assert code == 0
    assert found["intrinsics"]["fx"] == read_color(photos / "mine.toml").fx
    assert set(found["sigmas"]) == {"fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"}
    assert len(found["images"]) == 12


@pytest.mark.parametrize("arguments", [[], ["photos", "--squares", "7"], ["photos", "--kind", "x"]])
def test_wrong_usage_of_the_command_exits_with_2(vnav: Run, arguments: list[str]) -> None:
    assert vnav("calibrate", *arguments)[0] == 2
