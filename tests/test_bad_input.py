"""Bad input ends with one line that names it and exit code 1, never with a traceback."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from vnav.io.store.map_folder import FORMAT, MapFolder

FRAMES = 16  # enough of the tiny capture for a map

Vnav = Callable[..., tuple[int, str, str]]


@pytest.fixture
def capture(tiny_capture: Path, tmp_path: Path) -> Path:
    """The first frames of the tiny capture, to be spoilt."""
    folder = tmp_path / "capture"
    for kind in ("rgb", "depth"):
        lines = (tiny_capture / f"{kind}.txt").read_text().splitlines()
        header = [line for line in lines if line.startswith("#")]
        rows = lines[len(header) : len(header) + FRAMES]
        (folder / kind).mkdir(parents=True)
        (folder / f"{kind}.txt").write_text("\n".join([*header, *rows]) + "\n")
        for row in rows:
            shutil.copy(tiny_capture / row.split()[1], folder / kind)
    shutil.copy(tiny_capture / "camera.toml", folder)
    return folder


def fails(vnav: Vnav, capture: Path, *options: object) -> str:
    """The one line that build-map ends with."""
    target = () if "--map" in options else ("--map", capture.parent / "map")
    code, out, err = vnav("build-map", capture, *target, *options)
    assert (code, out) == (1, "")
    last = err.splitlines()[-1]
    assert last.startswith("vnav: ")
    return last


def test_an_empty_folder_is_no_capture(vnav: Vnav, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    assert "expected a capture" in fails(vnav, tmp_path / "empty")
    assert not (tmp_path / "map").exists()


def test_a_capture_that_is_not_there_is_named(vnav: Vnav, tmp_path: Path) -> None:
    assert str(tmp_path / "nowhere") in fails(vnav, tmp_path / "nowhere")


def test_a_missing_camera_is_asked_for(vnav: Vnav, capture: Path) -> None:
    (capture / "camera.toml").unlink()
    said = fails(vnav, capture)
    assert "camera.toml" in said
    assert "--camera" in said


@pytest.mark.parametrize("command", ["build-map", "check"])
def test_a_missing_camera_is_proposed_in_lines_of_its_own(
    vnav: Vnav, capture: Path, command: str
) -> None:
    (capture / "camera.toml").unlink()
    said = vnav(command, capture)[2].splitlines()
    proposed = said[said.index("[color]") : -1]
    corrected = "\n".join(proposed).replace("= 1000.0", "= 5000.0")
    (capture / "camera.toml").write_text(corrected)
    assert vnav("check", capture)[0] == 0


def test_colour_without_depth_is_no_capture(vnav: Vnav, capture: Path) -> None:
    (capture / "depth.txt").unlink()
    shutil.rmtree(capture / "depth")
    assert "depth" in fails(vnav, capture)


def test_depth_that_is_zero_everywhere_is_named(vnav: Vnav, capture: Path) -> None:
    for path in (capture / "depth").iterdir():
        cv2.imwrite(str(path), np.zeros((240, 320), np.uint16))
    assert "depth" in fails(vnav, capture)


@pytest.mark.parametrize("wrong", [500, 50000])
def test_depth_units_that_cannot_be_are_named_with_a_value_that_fits(
    wrong: int, vnav: Vnav, capture: Path
) -> None:
    camera = capture / "camera.toml"
    text = camera.read_text()
    assert "units_per_metre = 5000" in text
    camera.write_text(text.replace("5000", str(wrong)))
    said = fails(vnav, capture)
    assert "units_per_metre" in said
    assert "5000" in said
    assert "--force" in said


def test_two_sizes_of_images_are_named(vnav: Vnav, capture: Path) -> None:
    for path in sorted((capture / "rgb").iterdir())[::2]:
        image = cv2.imread(str(path))
        assert image is not None
        cv2.imwrite(str(path), cv2.resize(image, (160, 120)))
    said = fails(vnav, capture)
    assert "160" in said
    assert "320" in said


def test_a_map_of_another_format_is_left_alone(vnav: Vnav, capture: Path) -> None:
    folder = capture.parent / "map"
    folder.mkdir()
    (folder / "map.json").write_text('{"format": 99, "captures": []}\n')
    said = fails(vnav, capture)
    assert f"format {FORMAT}" in said
    assert "found 99" in said
    assert (folder / "map.json").read_text() == '{"format": 99, "captures": []}\n'


def test_a_map_of_another_capture_is_left_alone(vnav: Vnav, capture: Path) -> None:
    MapFolder.create(capture.parent / "map").set_captures(
        [{"id": 0, "name": "other", "fingerprint": "", "camera": {}}]
    )
    said = fails(vnav, capture)
    assert "expected other" in said
    assert "--fresh" in said


@pytest.mark.parametrize("place", ["/proc/vnav-map", "camera.toml/map"])
def test_a_map_that_cannot_be_written_is_named(place: str, vnav: Vnav, capture: Path) -> None:
    """Not even root can make a folder in /proc, or one inside a file."""
    said = fails(vnav, capture, "--map", capture / place)
    assert f"expected to write a map at {capture / place}" in said


def test_an_unknown_setting_is_named_before_any_work(vnav: Vnav, capture: Path) -> None:
    said = fails(vnav, capture, "--set", "odometry.max_depht_m=4")
    assert "did you mean 'odometry.max_depth_m'" in said


@pytest.mark.parametrize(
    "setting",
    [
        *("registration.ratio=-5", "fuse.voxel_m=0", "locate.min_confidence=7"),
        *("registration.ransac_threshold_px=-1", "locate.ransac_threshold_px=-1"),
        *("fuse.octree_m=-1", "locate.min_confidence=nan", "locate.solver=foo"),
    ],
)
@pytest.mark.parametrize(
    "command",
    [
        ("build-map", "capture", "--map", "new"),
        ("odometry", "capture", "--map", "new"),
        ("locate", "photo.jpg", "--map", "map"),
        ("plan", "--from", "0,0", "--to", "photo.jpg", "--map", "map"),
        ("evaluate", "suite.toml", "--out", "new"),
    ],
    ids=lambda command: command[0],
)
def test_a_bad_setting_stops_a_command_before_any_work(
    command: tuple[str, ...],
    setting: str,
    vnav: Vnav,
    capture: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    folder = capture.parent
    monkeypatch.chdir(folder)
    MapFolder.create(folder / "map")
    shutil.copy(next((capture / "rgb").iterdir()), folder / "photo.jpg")
    (folder / "suite.toml").write_text('[[sequence]]\nname = "a"\ncapture = "capture"\n')
    before = sorted(folder.rglob("*"))
    code, out, err = vnav(*command, "--set", setting)
    name, _, value = setting.partition("=")
    assert (code, out, err.count("\n")) == (1, "", 1)
    assert f"expected {name} to be " in err
    assert value in err
    assert sorted(folder.rglob("*")) == before


def test_a_truncated_image_is_skipped_and_named(vnav: Vnav, capture: Path) -> None:
    damaged = sorted((capture / "depth").iterdir())[FRAMES // 2]
    damaged.write_bytes(damaged.read_bytes()[:2000])
    options = "--map", capture.parent / "map", "--set", "features.max_features=500"
    code, out, err = vnav("build-map", capture, *options)
    assert code == 0
    assert f"{FRAMES - 1} of {FRAMES} frames tracked" in out
    assert damaged.name in out
    assert damaged.name in err


def test_a_photo_that_is_no_image_is_named(vnav: Vnav, whole_map: Path, tmp_path: Path) -> None:
    photo = tmp_path / "photo.jpg"
    photo.write_text("no image")
    code, out, err = vnav("locate", photo, "--map", whole_map)
    assert code == 1
    assert str(photo) in out + err
    assert "Traceback" not in err


def test_a_black_photo_is_not_located(vnav: Vnav, whole_map: Path, tmp_path: Path) -> None:
    photo = tmp_path / "black.png"
    cv2.imwrite(str(photo), np.zeros((240, 320, 3), np.uint8))
    code, out, _ = vnav("locate", photo, "--map", whole_map, "--json")
    assert code == 3
    answer = json.loads(out)
    assert answer["located"] is False
    assert answer["reason"]
    assert answer["T_world_camera"] is None


def test_a_photo_that_is_not_there_is_named(vnav: Vnav, whole_map: Path, tmp_path: Path) -> None:
    code, out, err = vnav("locate", tmp_path / "none.jpg", "--map", whole_map)
    assert code == 1
    assert str(tmp_path / "none.jpg") in out + err


def test_a_picture_of_a_path_gets_no_name_of_something_else(vnav: Vnav, tmp_path: Path) -> None:
    code, _, said = vnav("plan", "--from", "0,0", "--to", "1,1", "--png", tmp_path / "path.xyz")
    assert code == 2
    assert "expected a name that ends in .png" in said
    assert not (tmp_path / "path.xyz").exists()
