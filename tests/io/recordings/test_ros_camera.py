"""CameraInfo becomes the camera that its images need."""

from dataclasses import replace

import numpy as np
import pytest

from vnav.core.camera import Intrinsics
from vnav.errors import CameraError
from vnav.io.recordings.ros_camera import camera_of, intrinsics_of
from vnav.io.recordings.ros_messages import RosCameraInfo

BROWN = (0.1, -0.2, 0.001, 0.002, 0.03)
K = (500.0, 0.0, 320.5, 0.0, 501.0, 240.5, 0.0, 0.0, 1.0)
P = (480.0, 0.0, 318.0, 0.0, 0.0, 481.0, 241.0, 0.0, 0.0, 0.0, 1.0, 0.0)
INFO = RosCameraInfo("optical", 640, 480, "plumb_bob", BROWN, K, P, False)
TAKEN = Intrinsics(640, 480, 500.0, 501.0, 320.5, 240.5, BROWN)
RECTIFIED = Intrinsics(640, 480, 480.0, 481.0, 318.0, 241.0)


def test_images_as_taken_have_the_camera_matrix_and_the_distortion() -> None:
    assert intrinsics_of(INFO, "info", is_rectified=False) == TAKEN


def test_rectified_images_have_the_projection_matrix_and_no_distortion() -> None:
    assert intrinsics_of(INFO, "info", is_rectified=True) == RECTIFIED


def test_rectified_images_without_a_projection_have_the_camera_matrix() -> None:
    info = replace(INFO, P=(0.0,) * 12)
    assert intrinsics_of(info, "info", is_rectified=True) == replace(TAKEN, distortion=())


@pytest.mark.parametrize("model", ["plumb_bob", "equidistant", ""])
@pytest.mark.parametrize("D", [(), (0.0,) * 5])
def test_zeros_of_any_model_are_no_distortion(model: str, D: tuple[float, ...]) -> None:
    info = replace(INFO, distortion_model=model, D=D)
    assert intrinsics_of(info, "info", is_rectified=False).distortion == ()


def test_a_rational_model_that_does_not_divide_is_the_one_of_five() -> None:
    info = replace(INFO, distortion_model="rational_polynomial", D=(*BROWN, 0.0, 0.0, 0.0))
    assert intrinsics_of(info, "info", is_rectified=False) == TAKEN


@pytest.mark.parametrize(
    "changes",
    [
        {"distortion_model": "equidistant", "D": BROWN[:4]},
        {"distortion_model": "rational_polynomial", "D": (*BROWN, 0.1, 0.0, 0.0)},
        {"D": BROWN[:2]},
        {"D": (np.nan, *BROWN[1:])},
        {"is_part": True},
        {"K": (0.0,) * 9},
        {"K": (np.nan, *K[1:])},
        {"width": 0},
        {"width": 2**32 - 1},
    ],
)
def test_a_camera_that_vnav_has_not_is_an_error_that_names_the_topic(changes: dict) -> None:
    with pytest.raises(CameraError, match="expected .* in /camera/info, found"):
        intrinsics_of(replace(INFO, **changes), "/camera/info", is_rectified=False)


@pytest.mark.parametrize("depth", [None, TAKEN])
def test_depth_in_the_place_of_colour_is_registered(depth: Intrinsics | None) -> None:
    camera = camera_of(TAKEN, depth, np.eye(4), 1000.0)
    assert camera.is_registered
    assert camera.units_per_metre == 1000.0


def test_depth_of_another_size_has_a_camera_of_its_own() -> None:
    camera = camera_of(TAKEN, RECTIFIED, np.eye(4), 1000.0)
    assert camera.depth == RECTIFIED
    assert camera.T_color_depth == tuple(map(tuple, np.eye(4)))


def test_depth_from_another_place_keeps_where_it_was() -> None:
    T_color_depth = np.eye(4)
    T_color_depth[0, 3] = -0.025
    camera = camera_of(TAKEN, TAKEN, T_color_depth, 5000.0)
    assert camera.T_color_depth == tuple(map(tuple, T_color_depth))
