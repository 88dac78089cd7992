"""What a moving camera makes of a picture: a bright post before nothing, seen while it pans."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.synthetic import HANDHELD, MINIATURE, CaptureSpec, Scene, Sensor, one_room, write_capture
from vnav.synthetic.path import look
from vnav.synthetic.rendered_capture import camera_poses, exposed_frame
from vnav.synthetic.scene import Box
from vnav.synthetic.shutter import SLICE_S, exposed_color

CAMERA = Intrinsics(160, 120, 150.0, 150.0, 79.5, 59.5)
PAN_RAD_PER_S = 2.0
LINE_DELAY_S = 2e-4


@pytest.fixture(scope="module")
def post() -> Scene:
    """A post 1 m wide at 2 m, its left edge in the middle of the view along +x."""
    box = Box((2.5, -0.5, 1.0), (1.0, 1.0, 4.0), np.pi, "linen")
    return Scene(((box,),), (-5, -5, 5, 5, 5), (), 0)


def panning(after_s: np.ndarray) -> np.ndarray:
    """Poses of a camera that turns to its right."""
    zero = np.zeros_like(after_s)
    return look(np.tile([0.0, 0.0, 1.0], (len(after_s), 1)), -PAN_RAD_PER_S * after_s, zero, zero)


def left_edge(color: np.ndarray) -> np.ndarray:
    """Column (H,) where each row gets half as bright as the post."""
    bright = color.mean(2)
    half = np.median(bright[:, -20:]) / 2
    column = (bright > half).argmax(1)
    rows = np.arange(len(bright))
    before, after = bright[rows, column - 1], bright[rows, column]
    return column - (after - half) / (after - before)


def test_a_vertical_edge_leans_by_what_the_camera_turns_from_row_to_row(post: Scene) -> None:
    color = exposed_color(post, CAMERA, Sensor(line_delay_s=LINE_DELAY_S), panning)
    slope = np.polyfit(np.arange(CAMERA.height), left_edge(color), 1)[0]
    # The post moves to the left; its texture shifts half of its brightness by 0.1 px or so.
    assert slope == pytest.approx(-CAMERA.fx * PAN_RAD_PER_S * LINE_DELAY_S, rel=0.03)


def test_the_middle_row_is_seen_at_the_stamp(post: Scene) -> None:
    color = exposed_color(post, CAMERA, Sensor(line_delay_s=LINE_DELAY_S), panning)
    still = post.render_color(CAMERA, panning(np.zeros(1))[0])
    line = np.polyfit(np.arange(CAMERA.height) - CAMERA.cy, left_edge(color), 1)
    assert line[1] == pytest.approx(np.median(left_edge(still)), abs=0.15)


def test_an_edge_is_blurred_as_far_as_it_moves_while_exposed(post: Scene) -> None:
    exposure_s = 0.04
    color = exposed_color(post, CAMERA, Sensor(exposure_s=exposure_s), panning)
    row = color[CAMERA.height // 2].mean(1)
    level = row / np.median(row[-20:])
    moved_px = CAMERA.fx * PAN_RAD_PER_S * exposure_s
    begins, ends = (level > 0.05).argmax(), (level > 0.85).argmax()
    assert ends - begins == pytest.approx(0.8 * moved_px, abs=2)
    assert left_edge(color)[CAMERA.height // 2] == pytest.approx(CAMERA.cx, abs=2)


def test_each_row_is_exposed_for_as_long_as_any_other(post: Scene) -> None:
    """A camera at rest sees what a still one sees, to a grey level of rounding."""
    rest = lambda after_s: np.repeat(panning(np.zeros(1)), len(after_s), 0)  # noqa: E731
    sensor = Sensor(exposure_s=0.0073, line_delay_s=LINE_DELAY_S)
    color = exposed_color(post, CAMERA, sensor, rest)
    still = post.render_color(CAMERA, panning(np.zeros(1))[0])
    assert np.abs(color.astype(int) - still).max() <= 1


def test_without_delay_and_exposure_the_picture_is_that_of_a_still_camera(post: Scene) -> None:
    color = exposed_color(post, CAMERA, Sensor(), panning)
    np.testing.assert_array_equal(color, post.render_color(CAMERA, panning(np.zeros(1))[0]))


@pytest.mark.parametrize("tremor_deg", [0.0, 1.5])
def test_depth_is_of_where_the_camera_is_when_it_is_measured(tremor_deg: float) -> None:
    """A whole frame later: what the next frame's place shows."""
    scene = one_room(0)
    late = Sensor(depth_delay_s=1 / MINIATURE.rate_hz)
    spec = dataclasses.replace(MINIATURE, sensor=late, tremor_deg=tremor_deg)
    color, depth_m = exposed_frame(scene, spec, 7)
    here, there = camera_poses(scene, spec)[7:9]
    np.testing.assert_allclose(depth_m, scene.render_depth(spec.camera, there), atol=1e-6)
    np.testing.assert_array_equal(color, scene.render_color(spec.camera, here))


def test_the_same_moving_camera_gives_the_same_bytes(tmp_path: Path) -> None:
    sensor = Sensor(exposure_s=0.005, line_delay_s=1e-4, depth_delay_s=0.02)
    small = CAMERA.scaled(80, 60)
    spec = CaptureSpec("one_room", 3, 1, small, small, rate_hz=30.0, pan_deg=20.0, sensor=sensor)

    def images(name: str) -> list[bytes]:
        write_capture(tmp_path / name, spec)
        return [f.read_bytes() for f in sorted((tmp_path / name).glob("*/*.*g"))]

    assert images("first") == images("again")


def test_the_hand_pans_at_up_to_120_degrees_a_second() -> None:
    poses = camera_poses(one_room(0), HANDHELD)
    steps = se3.inverse(poses[:-1]) @ poses[1:]
    fastest = np.rad2deg(se3.rotation_angle(steps)).max() * HANDHELD.rate_hz
    assert 100 < fastest < 121
    assert np.linalg.norm(steps[:, :3, 3], axis=1).max() * HANDHELD.rate_hz < 1.0


def test_a_hand_that_trembles_and_rolls_turns_the_camera_where_it_is() -> None:
    scene, tremor_deg, roll_deg = one_room(0), 1.5, 12.0
    shaken = dataclasses.replace(HANDHELD, tremor_deg=tremor_deg, roll_deg=roll_deg)
    T = se3.inverse(camera_poses(scene, HANDHELD)) @ camera_poses(scene, shaken)
    np.testing.assert_allclose(T[:, :3, 3], 0, atol=1e-9)
    about_x, about_y, about_z = np.abs(np.rad2deg(se3.log_so3(T[:, :3, :3]))).max(0)
    assert 0.5 * tremor_deg < max(about_x, about_y) <= tremor_deg
    assert 0.8 * roll_deg < about_z <= roll_deg + tremor_deg


def test_a_slice_of_the_exposure_moves_the_picture_by_a_pixel_at_most() -> None:
    assert SLICE_S * np.deg2rad(120) * HANDHELD.camera.fx < 1.2
