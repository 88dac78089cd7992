"""What arrays may look like to be frames, and what is said of those that do not."""

import dataclasses
import re
from typing import Any

import numpy as np
import pytest

from vnav.core import se3
from vnav.core.camera import Camera, Intrinsics
from vnav.errors import CameraError, CaptureError, TrajectoryError, VnavError
from vnav.io.sources.memory import frames

N, H, W = 3, 6, 8
CAMERA = Camera(Intrinsics(W, H, 7.0, 7.0, 3.5, 2.5), 1000.0)
WIDE = Camera(Intrinsics(W, H, 6.0, 6.0, 3.5, 2.5), 1000.0)
COLOR = np.random.default_rng(0).integers(0, 256, (N, H, W, 3), np.uint8)
DEPTH = np.random.default_rng(1).integers(500, 3000, (N, H, W)).astype(np.uint16)
DEPTH_M = DEPTH / np.float32(1000)
POSES = se3.exp(np.arange(N)[:, None] * np.full(6, 0.01))


def test_stored_depth_and_depth_in_metres_are_the_same_frames() -> None:
    stored, metres = frames(COLOR, DEPTH, CAMERA), frames(COLOR, DEPTH_M, CAMERA)
    for k in range(N):
        np.testing.assert_array_equal(stored.read(k).depth_m, DEPTH_M[k])
        np.testing.assert_array_equal(metres.read(k).depth_m, DEPTH_M[k])


def test_lists_and_doubles_are_taken_like_arrays() -> None:
    listed = frames(list(COLOR), list(DEPTH_M.astype(np.float64)), CAMERA)
    arrays = frames(COLOR, DEPTH_M, CAMERA)
    assert listed.fingerprint() == arrays.fingerprint()
    np.testing.assert_array_equal(listed.read(1).depth_m, arrays.read(1).depth_m)


def test_colour_turned_from_bgr_by_a_view_is_taken() -> None:
    bgr = np.ascontiguousarray(COLOR[..., ::-1])
    np.testing.assert_array_equal(frames(bgr[..., ::-1], DEPTH, CAMERA).read(2).color, COLOR[2])


def test_images_are_not_copied() -> None:
    assert np.shares_memory(frames(COLOR, DEPTH_M, CAMERA).read(1).color, COLOR)


def test_depth_may_have_times_of_its_own() -> None:
    stamps_s = {"stamps_s": [0.0, 1.0, 2.0], "depth_stamps_s": [0.01, 1.0, 1.98]}
    capture = frames(COLOR, DEPTH, CAMERA, **stamps_s)
    found = [capture.read(k).depth_after_s for k in range(N)]
    np.testing.assert_allclose(found, [0.01, 0.0, -0.02], atol=1e-12)
    assert capture.fingerprint() != frames(COLOR, DEPTH, CAMERA, [0.0, 1.0, 2.0]).fingerprint()


def test_frames_without_times_are_a_thirtieth_of_a_second_apart() -> None:
    np.testing.assert_allclose(frames(COLOR, DEPTH, CAMERA).stamps_s, np.arange(N) / 30)


def test_without_depth_a_frame_has_zeros() -> None:
    capture = frames(COLOR, None, CAMERA)
    assert not capture.has_depth
    assert capture.read(0).depth_m.shape == (H, W)
    assert not capture.read(0).depth_m.any()
    assert capture.fingerprint() != frames(COLOR, DEPTH, CAMERA).fingerprint()


def test_each_frame_says_its_own_camera_and_the_first_is_the_captures() -> None:
    capture = frames(COLOR, DEPTH, [CAMERA, WIDE, CAMERA])
    assert [capture.read(k).intrinsics.fx for k in range(N)] == [7.0, 6.0, 7.0]
    assert capture.camera == CAMERA
    assert capture.fingerprint() != frames(COLOR, DEPTH, CAMERA).fingerprint()


def test_poses_that_are_not_known_are_left_out() -> None:
    assert frames(COLOR, DEPTH, CAMERA).poses is None
    poses = POSES.copy()
    poses[1] = np.nan
    known = frames(COLOR, DEPTH, CAMERA, [1.0, 2.0, 4.0], poses=poses).poses
    assert known is not None
    assert known.stamps_s.tolist() == [1.0, 4.0]
    np.testing.assert_array_equal(known.T_world_camera, POSES[[0, 2]])


def spoilt(values: np.ndarray, k: int, value: float) -> np.ndarray:
    result = values.copy()
    result[k, 3, 3] = value
    return result


@pytest.mark.parametrize(
    ("changes", "error", "why"),
    [
        ({"color": iter(COLOR)}, CaptureError, "an array (N, H, W, 3) or a list of images"),
        ({"color": COLOR[:0]}, CaptureError, "expected colour images, found none"),
        ({"color": COLOR[..., 0]}, CaptureError, "found uint8 of shape (6, 8) at frame 0"),
        ({"color": COLOR / 255}, CaptureError, "expected colour as uint8"),
        ({"color": [*COLOR[:2], COLOR[2, 1:]]}, CaptureError, "shape (5, 8, 3) at frame 2"),
        ({"depth": DEPTH[:2]}, CaptureError, "expected 3 depth images"),
        ({"depth": DEPTH[:, 1:]}, CaptureError, "shape (6, 8), the size that its camera says"),
        ({"depth": DEPTH.astype(np.int32)}, CaptureError, "found int32"),
        ({"depth": [DEPTH_M[0], DEPTH[1], DEPTH_M[2]]}, CaptureError, "uint16 of shape (6, 8) at"),
        ({"depth": spoilt(DEPTH_M, 1, np.nan)}, CaptureError, "NaN, infinity or less than 0 at"),
        ({"depth": spoilt(DEPTH_M, 1, np.inf)}, CaptureError, "less than 0 at frame 1"),
        ({"depth": spoilt(DEPTH_M, 2, -1.0)}, CaptureError, "less than 0 at frame 2"),
        ({"camera": [CAMERA, CAMERA]}, CameraError, "expected one camera or 3, one a frame"),
        ({"camera": CAMERA.color}, CameraError, "expected a Camera"),
        ({"stamps_s": [0.0, 1.0]}, CaptureError, "expected 3 times, one a frame, found shape (2,)"),
        ({"stamps_s": [0.0, 2.0, 1.0]}, CaptureError, "found 1.0 at frame 2"),
        ({"stamps_s": [0.0, 1.0, 1.0]}, CaptureError, "that increase, found 1.0 at frame 2"),
        ({"stamps_s": [0.0, np.nan, 1.0]}, CaptureError, "found nan at frame 1"),
        ({"depth_stamps_s": [0.0, 2.0, 1.0]}, CaptureError, "found 1.0 at frame 2"),
        ({"poses": POSES[:2]}, TrajectoryError, "expected poses of shape (3, 4, 4)"),
        ({"poses": 2 * POSES}, TrajectoryError, "a rotation and a translation as pose of frame 0"),
    ],
)
def test_what_does_not_fit_together_is_told(
    changes: dict[str, Any], error: type[VnavError], why: str
) -> None:
    arguments = {"color": COLOR, "depth": DEPTH, "camera": CAMERA} | changes
    with pytest.raises(error, match=re.escape(why)):
        frames(**arguments)


def test_depth_of_a_sensor_beside_has_that_sensors_size() -> None:
    sensor = Intrinsics(4, 3, 3.0, 3.0, 1.5, 1.0)
    T_color_depth = tuple(map(tuple, np.eye(4).tolist()))
    camera = dataclasses.replace(CAMERA, depth=sensor, T_color_depth=T_color_depth)
    capture = frames(COLOR, np.full((N, 3, 4), 2000, np.uint16), camera)
    np.testing.assert_allclose(capture.read(0).depth_m[2:4, 3:5], 2.0, rtol=1e-6)
    with pytest.raises(CaptureError, match=re.escape("float32 of shape (3, 4)")):
        frames(COLOR, DEPTH_M, camera)
