"""A camera before walls of speckle: its way is known, and what the filter makes of it."""

import cv2
import numpy as np
import pytest

from tests.registration.plane_views import CAMERA, Plane, speckle, view
from vnav.config import Config, load
from vnav.core import se3
from vnav.core.frame import Frame, Rejected
from vnav.registration.reduction import reduced
from vnav.tracking.ekf.camera_filter import CameraFilter, FilterImage, Followed
from vnav.tracking.ekf.image_turn import image_turn

STEP_M, STEP_S, STEPS = 0.02, 0.1, 12
SCENE = (Plane(2.0, speckle(1)), Plane(1.0, speckle(2), (-0.4, -0.5), (0.2, 0.5)))


def image_of(frame: Frame) -> FilterImage:
    gray = np.asarray(cv2.cvtColor(frame.color, cv2.COLOR_RGB2GRAY), np.uint8)
    return FilterImage(frame.color, gray, reduced(frame).grey, frame.depth_m)


def followed(frames: list[Frame], config: Config) -> tuple[CameraFilter, list[Followed | Rejected]]:
    made = CameraFilter(image_of(frames[0]), CAMERA, config, np.random.default_rng(0))
    return made, [made.track(image_of(frame), STEP_S) for frame in frames[1:]]


@pytest.fixture(scope="module")
def walk() -> list[Frame]:
    return [view(SCENE, k * STEP_M, seed=k, index=k) for k in range(STEPS + 1)]


def test_the_way_is_followed_in_metres(walk: list[Frame]) -> None:
    made, found = followed(walk, load("ekf"))
    assert all(isinstance(one, Followed) for one in found)
    T = made.state.T_world_camera
    # a third of a pixel at 262 px of focal length and 2 m is 2.5 mm. Before a wall, a camera's way
    # to the side looks like a turn: the near wall alone, a quarter of the image, tells them apart
    assert T[:3, 3] == pytest.approx([STEPS * STEP_M, 0, 0], abs=0.01)
    assert np.rad2deg(se3.rotation_angle(T)) < 0.3


def test_without_depth_the_way_is_followed_up_to_scale(walk: list[Frame]) -> None:
    made, found = followed(walk, load("mono"))
    assert all(isinstance(one, Followed) for one in found)
    T = made.state.T_world_camera
    direction = T[:3, 3] / np.linalg.norm(T[:3, 3])
    # features are expected at 2 m, give or take as much: nothing tells the scale but that
    assert 0.3 < np.linalg.norm(T[:3, 3]) / (STEPS * STEP_M) < 3
    assert direction == pytest.approx([1, 0, 0], abs=0.1)


def test_near_things_are_known_to_be_nearer_than_far_ones_without_depth(walk: list[Frame]) -> None:
    made, _ = followed(walk, load("mono"))
    points = made.finish()
    in_first = points[points[:, 2] > 0]
    px = CAMERA.project(in_first)
    x_near = (px[:, 0] - CAMERA.cx) / CAMERA.fx
    near = (x_near > -0.35) & (x_near < 0.15)
    assert near.sum() >= 3
    assert (~near).sum() >= 3
    ratio = np.median(in_first[~near][:, 2]) / np.median(in_first[near][:, 2])
    assert ratio == pytest.approx(2.0, rel=0.2)


def test_what_moves_by_itself_is_left_out(walk: list[Frame]) -> None:
    """A box rises. Three things stand still: a motion explains two depths, and no third."""
    still = [SCENE[0], SCENE[1], Plane(1.4, speckle(5), (0.35, -0.6), (0.9, 0.0))]
    box = Plane(0.9, speckle(3), (0.25, 0.0), (0.6, 0.35))
    frames = [view([*still, box.moved(0, -k * STEP_M)], k * STEP_M, seed=k) for k in range(9)]
    made, found = followed(frames, load("ekf"))
    assert all(isinstance(one, Followed) for one in found)
    assert made.state.T_world_camera[:3, 3] == pytest.approx([8 * STEP_M, 0, 0], abs=0.01)


def test_the_state_and_the_draws_are_bounded(walk: list[Frame]) -> None:
    made, found = followed(walk, load("ekf", ["tracking.ekf.max_features=20"]))
    assert len(made.numbers) <= 20
    assert all(isinstance(one, Followed) and one.predicted <= 20 for one in found)
    assert all(isinstance(one, Followed) and one.draws <= 300 for one in found)


def test_a_camera_that_sees_nothing_is_lost_and_found_again(walk: list[Frame]) -> None:
    black = np.zeros_like(walk[0].color)
    dark = [Frame(0, k, 0.0, black, walk[k].depth_m, CAMERA) for k in (5, 6)]
    made, found = followed([*walk[:5], *dark, *walk[7:]], load("ekf"))
    assert [isinstance(one, Rejected) for one in found[3:7]] == [False, True, True, False]
    assert made.state.T_world_camera[:3, 3] == pytest.approx([STEPS * STEP_M, 0, 0], abs=0.01)
    # from the last frame that was found, three steps before
    made, found = followed([*walk[:5], *dark, walk[7]], load("ekf"))
    assert made.state.T_before_camera[:3, 3] == pytest.approx([3 * STEP_M, 0, 0], abs=0.01)


def test_an_image_without_corners_gives_nothing_to_follow() -> None:
    grey = np.full((240, 320, 3), 90, np.uint8)
    blank = Frame(0, 0, 0.0, grey, np.full((240, 320), 2, np.float32), CAMERA)
    made = CameraFilter(image_of(blank), CAMERA, load("ekf"), np.random.default_rng(0))
    assert not made.can_follow
    assert isinstance(made.track(image_of(blank), STEP_S), Rejected)


def test_a_turned_image_tells_shift_and_angle() -> None:
    rng = np.random.default_rng(3)
    wide = cv2.GaussianBlur(rng.standard_normal((240, 320)), (0, 0), 6) * 800 + 128
    angle, shift = np.deg2rad(3.0), np.array([9.0, -4.0])
    M = np.zeros((2, 3))
    M[:, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    middle = np.array([159.5, 119.5])
    M[:, 2] = middle + shift - M[:, :2] @ middle
    before, after = (
        np.ascontiguousarray(image[60:180, 80:240].astype(np.float32))
        for image in (wide, cv2.warpAffine(wide, M, (320, 240)))
    )
    kept = before.copy(), after.copy()
    found = image_turn(before, after)
    np.testing.assert_array_equal(kept, (before, after))
    # blocks of two pixels are aligned: to a fifth of one, and that at half of the image's width
    assert found[:2] == pytest.approx(shift, abs=0.4)
    assert found[2] == pytest.approx(angle, abs=np.deg2rad(0.3))


def test_images_that_have_nothing_in_common_tell_no_turn() -> None:
    rng = np.random.default_rng(4)
    before, after = rng.standard_normal((2, 120, 160)).astype(np.float32)
    assert np.isnan(image_turn(before, after)).all()
