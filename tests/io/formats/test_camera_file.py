from pathlib import Path

import numpy as np
import pytest

from vnav import config
from vnav.config import preset_cameras
from vnav.core.camera import Camera, Intrinsics
from vnav.errors import CameraError
from vnav.io.formats.camera_file import camera_text, preset_camera, read_camera, read_color

COLOR = """
[color]
width = 640
height = 480
fx = 525
fy = 524.5
cx = 320.0
cy = 240.0
"""
UNITS = """
[depth]
units_per_metre = 1000
"""
SENSOR = """
fx = 585.0
fy = 585.0
cx = 319.0
cy = 239.0
"""
TRANSFORM = "T_color_depth = [[1, 0, 0, -0.025], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n"
UNREGISTERED = COLOR + UNITS + SENSOR + TRANSFORM


@pytest.fixture
def written(tmp_path: Path):
    def write(text: str) -> Path:
        path = tmp_path / "camera.toml"
        path.write_text(text)
        return path

    return write


def test_depth_is_registered_where_only_its_units_are_given(written) -> None:
    camera = read_camera(written(COLOR + UNITS))
    assert camera == Camera(Intrinsics(640, 480, 525.0, 524.5, 320.0, 240.0), 1000.0)
    assert camera.is_registered


def test_an_unregistered_depth_camera_has_the_size_of_the_colour_camera_unless_it_says_so(
    written,
) -> None:
    camera = read_camera(written(UNREGISTERED))
    assert camera.depth == Intrinsics(640, 480, 585.0, 585.0, 319.0, 239.0)
    assert camera.T_color_depth is not None
    assert camera.T_color_depth[0] == (1.0, 0.0, 0.0, -0.025)
    smaller = read_camera(
        written(UNREGISTERED.replace("fx = 585.0", "width = 320\nheight = 240\nfx = 5.0"))
    )
    assert smaller.depth is not None
    assert smaller.depth.size == (320, 240)


def test_registered_depth_of_another_size_has_the_view_of_colour(written) -> None:
    camera = read_camera(written(COLOR + UNITS + "width = 320\nheight = 240\n"))
    assert camera.depth == camera.color.scaled(320, 240)
    assert camera.T_color_depth == tuple(map(tuple, np.eye(4)))
    same = read_camera(written(COLOR + UNITS + "width = 640\nheight = 480\n"))
    assert same.is_registered


def test_four_or_five_distortion_coefficients_are_read_and_zeros_mean_none(written) -> None:
    for text, expected in (
        ("[0.1, -0.2, 0.0, 0.001]", (0.1, -0.2, 0.0, 0.001)),
        ("[0.1, -0.2, 0, 0, 0.3]", (0.1, -0.2, 0.0, 0.0, 0.3)),
        ("[0, 0, 0, 0, 0]", ()),
    ):
        camera = read_camera(written(COLOR + f"distortion = {text}\n" + UNITS))
        assert camera.color.distortion == expected


def test_a_photo_needs_no_depth_camera(written) -> None:
    assert read_color(written(COLOR)).fy == 524.5
    with pytest.raises(CameraError, match=r"expected a table \[depth\]"):
        read_camera(written(COLOR))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("fx = 525\n", "", "expected a positive number for fx in .color. of .*found none"),
        ("fx = 525\n", "fx = 0\n", "positive number for fx in .color.*found 0"),
        ("fx = 525\n", "fx = -525.0\n", "positive number for fx"),
        ("fx = 525\n", "fx = 1e-320\n", "positive number for fx"),
        ("width = 640", "width = 70000", "number of pixels for width in .*found 70000"),
        ("units_per_metre = 1000", "units_per_metre = 1e-9", "number for units_per_metre"),
        ("fx = 525\n", "fx = nan\n", "positive number for fx"),
        ("fx = 525\n", "fx = 1e308\n", "positive number for fx"),
        ("fx = 525\n", f"fx = 1{'0' * 400}\n", "positive number for fx"),
        ("fx = 525\n", "fx = '525'\n", "positive number for fx in .*found '525'"),
        ("fx = 525\n", "fx = true\n", "positive number for fx in .*found True"),
        ("fx = 525\n", "fx = 525\nfocal = 1\n", "unknown key 'focal' in .color."),
        ("cx = 320.0", "cx = inf", "a number for cx"),
        ("width = 640", "width = 640.0", "number of pixels for width in .*found 640.0"),
        ("height = 480", "height = 0", "number of pixels for height"),
        ("cy = 240.0\n", "cy = 240.0\ndistortion = [1, 2, 3]\n", "expected distortion = .k1"),
        ("cy = 240.0\n", "cy = 240.0\ndistortion = 'none'\n", "expected distortion = .k1"),
        ("[color]", "[colour]", "unknown key 'colour' in .*did you mean 'color'"),
        ("units_per_metre = 1000", "", "expected a positive number for units_per_metre"),
        ("units_per_metre = 1000", "units_per_meter = 1000", "did you mean 'units_per_metre'"),
        ("fx = 585.0", "", r"expected a positive number for fx in \[depth\]"),
        (TRANSFORM, "", "expected T_color_depth in .depth."),
        (SENSOR, "", r"expected a positive number for fx in \[depth\]"),
        ("[[1, 0, 0, -0.025], [0", "[[2, 0, 0, -0.025], [0", "not rigid"),
        ("[[1, 0, 0, -0.025], [0", "[[-1, 0, 0, -0.025], [0", "not rigid"),
        (", [0, 0, 0, 1]]", "]", "4 rows of 4 numbers"),
        ("-0.025", "-25.0", "in metres, found the cameras 25 m apart"),
        ("[color]", "[color", "expected TOML"),
    ],
)
def test_what_is_wrong_is_named(written, old: str, new: str, message: str) -> None:
    assert old in UNREGISTERED
    path = written(UNREGISTERED.replace(old, new))
    with pytest.raises(CameraError, match=message) as error:
        read_camera(path)
    assert str(path) in str(error.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(CameraError, match="expected a camera file at .*nothing.toml"):
        read_camera(tmp_path / "nothing.toml")


def test_the_tum_presets_are_the_published_calibrations() -> None:
    published = {
        "tum_fr1": (517.3, 516.5, 318.6, 255.3, (0.2624, -0.9531, -0.0054, 0.0026, 1.1633)),
        "tum_fr2": (520.9, 521.0, 325.1, 249.7, (0.2312, -0.7849, -0.0033, -0.0001, 0.9172)),
        "tum_fr3": (535.4, 539.2, 320.1, 247.6, ()),
    }
    for name, (fx, fy, cx, cy, distortion) in published.items():
        color = Intrinsics(640, 480, fx, fy, cx, cy, distortion)
        assert preset_camera(name) == Camera(color, 5000.0)


def test_an_unknown_preset_lists_the_known_ones() -> None:
    with pytest.raises(CameraError, match="tum_fr1, tum_fr2, tum_fr3.*found 'fr1'"):
        preset_camera("fr1")


def test_every_camera_has_a_preset_of_its_name_that_uses_it() -> None:
    assert preset_cameras()
    for name in preset_cameras():
        assert config.load(name).capture.preset_camera == name


@pytest.mark.parametrize("has_own_depth", [False, True])
def test_a_camera_that_is_written_is_read_the_same(has_own_depth: bool, tmp_path: Path) -> None:
    color = Intrinsics(640, 480, 525.1, 1 / 3, 319.5, 239.5, (0.1, -0.2, 0.001, 0.0, 1e-17))
    T_color_depth = ((1.0, 0.0, 0.0, -0.025), (0.0, 1.0, 0.0, 1e-9), (0.0, 0.0, 1.0, 0.0))
    own = (Intrinsics(32, 24, 9.0, 9.5, 15.5, 11.5), (*T_color_depth, (0.0, 0.0, 0.0, 1.0)))
    camera = Camera(color, 5000.0, *(own if has_own_depth else ()))
    path = tmp_path / "camera.toml"
    path.write_text(camera_text(camera))
    assert read_camera(path) == camera
