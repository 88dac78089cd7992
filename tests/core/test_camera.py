import dataclasses

import numpy as np
import pytest

from vnav.core.camera import Camera, Intrinsics, registered_camera

CAMERA = Intrinsics(640, 480, 525.0, 520.0, 319.5, 239.5)


def test_a_point_ahead_is_seen_at_the_principal_point() -> None:
    np.testing.assert_allclose(CAMERA.project([0, 0, 2.0]), [319.5, 239.5])


def test_right_and_down_are_positive() -> None:
    np.testing.assert_allclose(CAMERA.project([0.2, 0.1, 2.0]), [319.5 + 52.5, 239.5 + 26.0])


def test_projecting_undoes_unprojecting() -> None:
    rng = np.random.default_rng(0)
    px, z = rng.uniform(0, 480, (50, 2)), rng.uniform(0.3, 9, 50)
    points = CAMERA.unproject(px, z)
    np.testing.assert_allclose(CAMERA.project(points), px, atol=1e-9)
    np.testing.assert_array_equal(points[:, 2], z)


def test_what_lies_behind_or_nowhere_has_no_pixel() -> None:
    px = CAMERA.project([[0, 0, -1.0], [0, 0, 0], [np.nan, 0, np.nan]])
    assert np.isnan(px).all()


def test_no_points_give_no_pixels() -> None:
    assert CAMERA.project(np.zeros((0, 3))).shape == (0, 2)
    assert CAMERA.unproject(np.zeros((0, 2)), np.zeros(0)).shape == (0, 3)


def test_a_resized_camera_keeps_the_corners_of_the_image() -> None:
    # Pixel centres are at integers, so the image reaches from -0.5 to width - 0.5.
    half = CAMERA.scaled(320, 240)
    for corner in ([-0.5, -0.5], [639.5, 479.5]):
        ray = CAMERA.unproject(corner, 1.0)
        np.testing.assert_allclose(half.project(ray), (np.array(corner) + 0.5) / 2 - 0.5)
    assert half.size == (320, 240)


def test_the_calibration_matrix_projects() -> None:
    point = np.array([0.3, -0.2, 1.7])
    u, v, w = CAMERA.K @ point
    np.testing.assert_allclose([u / w, v / w], CAMERA.project(point))


def test_depth_of_fewer_pixels_with_the_view_of_colour_is_registered() -> None:
    coarse = registered_camera(CAMERA, 1000.0, (CAMERA.width // 2, CAMERA.height // 2))
    assert coarse.depth == CAMERA.scaled(CAMERA.width // 2, CAMERA.height // 2)
    assert coarse.is_registered
    assert registered_camera(CAMERA, 1000.0, CAMERA.size) == Camera(CAMERA, 1000.0)


def test_a_camera_without_depth_intrinsics_is_registered() -> None:
    assert Camera(CAMERA, 1000.0).is_registered
    assert not Camera(CAMERA, 1000.0, CAMERA, ((1.0,),)).is_registered


@pytest.mark.parametrize("length", ["fx", "fy", "cx", "cy"])
@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_no_camera_has_a_length_that_is_no_number(length: str, value: float) -> None:
    camera = Intrinsics(640, 480, 500.0, 500.0, 320.0, 240.0)
    assert camera.is_possible
    assert not dataclasses.replace(camera, **{length: value}).is_possible
