"""What every reader of tools' camera files must hold: a new one adds a line to WRITERS."""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from vnav.config import CaptureConfig
from vnav.core.camera import Camera, Intrinsics
from vnav.errors import CameraError
from vnav.io.cameras.tool_files import FORMATS
from vnav.io.formats.camera_file import read_camera, read_color
from vnav.io.sources.open_capture import open_capture

COLOR = Intrinsics(32, 24, 30.25, 30.5, 15.75, 11.25)
LENS = (0.1, -0.05, 0.001, 0.002, 0.01)
CORNER = 0.5  # from the corner of the image to the centre of its first pixel


@dataclass(frozen=True)
class Written:
    """A camera as a tool writes it; ``units_per_metre`` None where its format does not tell."""

    text: str
    units_per_metre: float | None


def by_columns(k: Intrinsics, shift: float = 0.0) -> list[float]:
    return [k.fx, 0.0, 0.0, 0.0, k.fy, 0.0, k.cx + shift, k.cy + shift, 1.0]


def open3d(k: Intrinsics) -> Written:
    values = {"width": k.width, "height": k.height, "intrinsic_matrix": by_columns(k)}
    return Written(json.dumps(values), 1000.0)


def ros(k: Intrinsics) -> Written:
    """As camera_calibration writes ost.yaml."""
    distortion = [*k.distortion, *[0.0] * (5 - len(k.distortion))]
    return Written(
        f"""image_width: {k.width}
image_height: {k.height}
camera_name: head_camera
camera_matrix:
  rows: 3
  cols: 3
  data: [{k.fx}, 0.     , {k.cx},
         0.     , {k.fy}, {k.cy},
         0.     , 0.     , 1.     ]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: {distortion}
projection_matrix:
  rows: 3
  cols: 4
  data: [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0.]
""",
        1000.0,
    )


def colmap(k: Intrinsics) -> Written:
    head = "# Camera list with one line of data per camera:\n# Number of cameras: 1\n"
    numbers = [k.fx, k.fy, k.cx + CORNER, k.cy + CORNER]
    if k.distortion:
        numbers += [*k.distortion, 0, 0, 0]
    model = "FULL_OPENCV" if k.distortion else "PINHOLE"
    words = [1, model, k.width, k.height, *numbers]
    return Written(head + " ".join(map(str, words)) + "\n", None)


def record3d(k: Intrinsics) -> Written:
    values = {"w": k.width, "h": k.height, "fps": 60, "K": by_columns(k, CORNER), "dw": 8, "dh": 6}
    return Written(json.dumps(values), None)


def nerf(k: Intrinsics) -> Written:
    """As instant-ngp's tools write it: sizes with a point, depth's unit in metres."""
    values = {"w": float(k.width), "h": float(k.height), "fl_x": k.fx, "fl_y": k.fy}
    values |= {"cx": k.cx + CORNER, "cy": k.cy + CORNER, "integer_depth_scale": 0.0002}
    values |= dict(zip(("k1", "k2", "p1", "p2", "k3"), k.distortion, strict=False))
    return Written(json.dumps(values | {"frames": []}), 5000.0)


WRITERS: dict[str, Callable[[Intrinsics], Written]] = {
    "Open3D": open3d,
    "ROS camera_info": ros,
    "COLMAP": colmap,
    "Record3D": record3d,
    "NeRF": nerf,
}
WITH_DISTORTION = ("ROS camera_info", "COLMAP", "NeRF")
PLACES = [(reader.NAME, name) for reader in FORMATS for name in reader.FILES]


@pytest.fixture(params=FORMATS, ids=lambda reader: reader.NAME)
def written(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Path, Written]:
    """The camera in the file of a tool."""
    return save(tmp_path, request.param.NAME, COLOR)


def save(folder: Path, name: str, color: Intrinsics, file: str = "") -> tuple[Path, Written]:
    files = next(reader.FILES for reader in FORMATS if name == reader.NAME)
    path = folder / (file or files[0])
    path.parent.mkdir(parents=True, exist_ok=True)
    content = WRITERS[name](color)
    path.write_text(content.text)
    return path, content


@pytest.fixture
def capture(tmp_path: Path) -> Path:
    """A folder of one frame, without a camera."""
    root = tmp_path / "capture"
    for name, image in (("color", np.zeros((24, 32, 3), np.uint8)), ("depth", np.uint16(2000))):
        (root / name).mkdir(parents=True)
        whole = np.broadcast_to(image, (24, 32, 3) if name == "color" else (24, 32))
        cv2.imwrite(str(root / name / "000000.png"), whole)
    return root


def test_every_format_is_held_to_this() -> None:
    assert [reader.NAME for reader in FORMATS] == list(WRITERS)


def test_the_colour_camera_comes_back(written: tuple[Path, Written]) -> None:
    path, _ = written
    assert read_color(path) == COLOR


def test_the_units_of_depth_are_those_of_the_file_or_of_the_tool(
    written: tuple[Path, Written],
) -> None:
    path, content = written
    if content.units_per_metre is not None:
        assert read_camera(path) == Camera(COLOR, pytest.approx(content.units_per_metre))


def test_units_that_a_format_does_not_tell_are_asked_for(written: tuple[Path, Written]) -> None:
    path, content = written
    if content.units_per_metre is None:
        with pytest.raises(CameraError, match=r"capture.units_per_metre=1000.*camera.toml") as told:
            read_camera(path)
        assert str(path) in str(told.value)
        proposed = path.with_name("camera.toml")
        proposed.write_text("\n".join(told.value.__notes__))
        assert read_camera(proposed) == Camera(COLOR, 1000.0)


def test_units_that_are_set_come_before_those_of_the_file(written: tuple[Path, Written]) -> None:
    assert read_camera(written[0], units_per_metre=500.0) == Camera(COLOR, 500.0)


def test_without_depth_no_units_are_needed(written: tuple[Path, Written]) -> None:
    assert read_camera(written[0], has_depth=False).color == COLOR


@pytest.mark.parametrize("name", WITH_DISTORTION)
def test_distortion_comes_back(name: str, tmp_path: Path) -> None:
    camera = replace(COLOR, distortion=LENS)
    assert read_color(save(tmp_path, name, camera)[0]) == camera


@pytest.mark.parametrize(("name", "file"), PLACES)
def test_a_capture_takes_its_camera_from_where_the_tool_writes_it(
    name: str, file: str, capture: Path
) -> None:
    save(capture, name, COLOR, file)
    opened = open_capture(capture, CaptureConfig(units_per_metre=1000.0))
    assert opened.camera == Camera(COLOR, 1000.0)
    assert opened.read(0).depth_m.max() == 2.0


@pytest.mark.parametrize("seed", range(60))
def test_damage_is_refused_in_one_line_or_makes_another_camera(
    written: tuple[Path, Written], seed: int
) -> None:
    path, content = written
    rng = np.random.default_rng(seed)
    text = list(content.text)
    at = int(rng.integers(len(text)))
    pieces = ("", "[", "]", "-", "nan", "1e999", '"x"', "{}", "null", ":", "#", "\n", "9" * 400)
    text[at : at + int(rng.integers(1, 30))] = pieces[seed % len(pieces)]
    path.write_text("".join(text))
    found = camera_or_refusal(path)
    if isinstance(found, Camera):
        assert found.color.is_possible
    else:
        assert str(path) in found
        assert "\n" not in found


def camera_or_refusal(path: Path) -> Camera | str:
    try:
        return read_camera(path)
    except CameraError as error:
        return str(error)


def test_a_file_that_is_none_of_these_is_told(tmp_path: Path) -> None:
    path = tmp_path / "other.json"
    path.write_text('{"focal": 30}')
    with pytest.raises(CameraError, match=r"camera file of Open3D, .*NeRF, at .*other.json"):
        read_color(path)


def test_a_missing_file_is_told(tmp_path: Path) -> None:
    with pytest.raises(CameraError, match=r"expected a camera file at .*nowhere.json"):
        read_color(tmp_path / "nowhere.json")


def test_a_camera_toml_comes_before_a_tools_file_and_that_before_a_preset(capture: Path) -> None:
    save(capture, "Open3D", COLOR)
    assert open_capture(capture, CaptureConfig(preset_camera="tum_fr3")).camera.color == COLOR
    own = "".join(f"{key} = {value}\n" for key, value in vars(COLOR).items() if value != ())
    (capture / "camera.toml").write_text(
        f"[color]\n{own}[depth]\nunits_per_metre = 5000\n".replace("fx = 30.25", "fx = 31")
    )
    assert open_capture(capture, CaptureConfig()).camera.color.fx == 31.0


def test_two_files_of_tools_are_one_too_many(capture: Path) -> None:
    save(capture, "Open3D", COLOR)
    save(capture, "COLMAP", COLOR, "sparse/0/cameras.txt")
    with pytest.raises(
        CameraError, match=r"found camera_intrinsic.json, sparse/0/cameras.txt; .*--camera FILE"
    ):
        open_capture(capture, CaptureConfig())


def test_a_metadata_file_that_tells_of_no_camera_is_left_alone(capture: Path) -> None:
    (capture / "metadata").write_bytes(b"\xff\x00 of something else")
    (capture / "metadata.json").write_text('{"author": "me"}')
    preset = CaptureConfig(preset_camera="tum_fr3")
    assert open_capture(capture, preset).camera.color.fx == 535.4


def refused(tmp_path: Path, file: str, text: str) -> str:
    path = tmp_path / file
    path.write_text(text)
    with pytest.raises(CameraError) as told:
        read_color(path)
    return str(told.value)


def test_a_matrix_stored_the_other_way_is_told(tmp_path: Path) -> None:
    rows = [30.0, 0.0, 15.5, 0.0, 30.0, 11.5, 0.0, 0.0, 1.0]
    text = json.dumps({"width": 32, "height": 24, "intrinsic_matrix": rows})
    assert "fx, 0, 0, 0, fy, 0, cx, cy, 1" in refused(tmp_path, "intrinsic.json", text)


def test_open3d_tells_units_where_it_knows_them(tmp_path: Path) -> None:
    values = json.loads(open3d(COLOR).text) | {"depth_scale": 4000.0, "device_name": "RealSense"}
    (tmp_path / "intrinsic.json").write_text(json.dumps(values))
    assert read_camera(tmp_path / "intrinsic.json").units_per_metre == 4000.0


def test_what_open3d_itself_writes_is_read(tmp_path: Path) -> None:
    import open3d as o3d

    camera = o3d.camera.PinholeCameraIntrinsic(*COLOR.size, COLOR.fx, COLOR.fy, COLOR.cx, COLOR.cy)
    o3d.io.write_pinhole_camera_intrinsic(str(tmp_path / "camera_intrinsic.json"), camera)
    recording = o3d.t.io.RGBDVideoMetadata()
    recording.width, recording.height = COLOR.size
    recording.intrinsics, recording.depth_scale = camera, 4000.0
    (tmp_path / "intrinsic.json").write_text(str(recording))
    assert read_camera(tmp_path / "camera_intrinsic.json") == Camera(COLOR, 1000.0)
    assert read_camera(tmp_path / "intrinsic.json") == Camera(COLOR, 4000.0)


@pytest.mark.parametrize("nested", [False, True])
def test_a_camera_info_message_is_read_as_ros2_prints_it(tmp_path: Path, nested: bool) -> None:
    k = COLOR
    lines = ["header:", "  stamp:", "    sec: 3", "    nanosec: 0", "  frame_id: camera_color"]
    lines += [f"height: {k.height}", f"width: {k.width}", "distortion_model: plumb_bob", "d:"]
    lines += [f"- {value}" for value in LENS]
    lines += ["k:", *(f"- {value}" for value in [k.fx, 0.0, k.cx, 0.0, k.fy, k.cy, 0.0, 0.0, 1.0])]
    lines += ["roi:", "  height: 0", "  do_rectify: false"]
    lines = ["camera_info:", *(f"  {line}" for line in lines)] if nested else [*lines, "---"]
    (tmp_path / "camera_info.yaml").write_text("\n".join(lines))
    assert read_color(tmp_path / "camera_info.yaml") == replace(COLOR, distortion=LENS)


@pytest.mark.parametrize(
    ("model", "coefficients", "told"),
    [
        ("rational_polynomial", "[0.1, 0, 0, 0, 0, 0.2, 0.1, 0]", "rational_polynomial with"),
        ("equidistant", "[0.1, 0, 0, 0]", "found equidistant"),
    ],
)
def test_a_lens_of_ros_beyond_our_model_is_named(
    tmp_path: Path, model: str, coefficients: str, told: str
) -> None:
    text = ros(COLOR).text.replace("plumb_bob", model)
    text = text.replace("[0.0, 0.0, 0.0, 0.0, 0.0]", coefficients)
    assert told in refused(tmp_path, "ost.yaml", text)


def test_a_rational_polynomial_whose_denominator_is_one_is_read(tmp_path: Path) -> None:
    lens = str([*LENS, 0.0, 0.0, 0.0])
    text = ros(COLOR).text.replace("plumb_bob", "rational_polynomial")
    (tmp_path / "ost.yaml").write_text(text.replace("[0.0, 0.0, 0.0, 0.0, 0.0]", lens))
    assert read_color(tmp_path / "ost.yaml").distortion == LENS


@pytest.mark.parametrize(
    ("line", "distortion"),
    [
        ("1 SIMPLE_PINHOLE 32 24 30 16 12", ()),
        ("1 SIMPLE_RADIAL 32 24 30 16 12 0.1", (0.1, 0, 0, 0, 0)),
        ("1 RADIAL 32 24 30 16 12 0.1 0.2", (0.1, 0.2, 0, 0, 0)),
        ("1 OPENCV 32 24 30 30 16 12 0.1 0.2 0.3 0.4", (0.1, 0.2, 0.3, 0.4, 0)),
    ],
)
def test_each_model_of_colmap_that_ours_holds_is_read(
    tmp_path: Path, line: str, distortion: tuple[float, ...]
) -> None:
    (tmp_path / "cameras.txt").write_text(line + "\n")
    expected = Intrinsics(32, 24, 30.0, 30.0, 15.5, 11.5, distortion)
    assert read_color(tmp_path / "cameras.txt") == expected


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("1 OPENCV_FISHEYE 32 24 30 30 16 12 0 0 0 0\n", "found OPENCV_FISHEYE"),
        ("1 PINHOLE 32 24 30 30 16\n", "expected 4 parameters of PINHOLE, found 3"),
        ("1 PINHOLE 32 24 30 30 16 12\n2 PINHOLE 32 24 31 31 16 12\n", "found 2"),
        ("1 FULL_OPENCV 32 24 30 30 16 12 0 0 0 0 0 0.1 0 0\n", "found FULL_OPENCV"),
    ],
)
def test_what_colmap_says_and_we_cannot_hold_is_named(tmp_path: Path, text: str, told: str) -> None:
    assert told in refused(tmp_path, "cameras.txt", text)


def test_record3d_with_a_focus_that_moves_is_refused(tmp_path: Path) -> None:
    values = json.loads(record3d(COLOR).text)
    values["perFrameIntrinsicCoeffs"] = [[30, 30, 16, 12], [31, 31, 16, 12]]
    assert "focus locked" in refused(tmp_path, "metadata", json.dumps(values))


def test_an_angle_of_view_is_a_focal_length(tmp_path: Path) -> None:
    values = {"camera_angle_x": 2 * math.atan(0.5), "w": 32, "h": 24, "frames": []}
    (tmp_path / "transforms.json").write_text(json.dumps(values))
    found = read_color(tmp_path / "transforms.json")
    assert (found.fx, found.fy) == (pytest.approx(32.0), pytest.approx(32.0))
    assert (found.cx, found.cy) == (15.5, 11.5)


def test_depth_that_nerfstudio_lists_is_in_millimetres(tmp_path: Path) -> None:
    values = json.loads(nerf(COLOR).text)
    del values["integer_depth_scale"]
    values["frames"] = [{"file_path": "0.png", "depth_file_path": "depth/0.png"}]
    (tmp_path / "transforms.json").write_text(json.dumps(values))
    assert read_camera(tmp_path / "transforms.json").units_per_metre == 1000.0


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"camera_model": "OPENCV_FISHEYE"}, "found OPENCV_FISHEYE"),
        ({"frames": [{"fl_x": 30.0}, {"fl_x": 31.0}]}, "one camera for all frames"),
        ({"w": None}, "found w = None"),
        ({"k4": 0.1}, "undistort the images"),
    ],
)
def test_what_a_nerf_file_says_and_we_cannot_hold_is_named(
    tmp_path: Path, changed: dict[str, object], told: str
) -> None:
    text = json.dumps(json.loads(nerf(COLOR).text) | changed)
    assert told in refused(tmp_path, "transforms.json", text)
