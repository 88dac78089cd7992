"""Keypoints to 3D points, on planes that are known exactly."""

import numpy as np
import pytest

from vnav.config import RegistrationConfig
from vnav.core.camera import Intrinsics
from vnav.features.lifting import lift

CAMERA = Intrinsics(160, 120, 130.0, 130.0, 79.5, 59.5)
CONFIG = RegistrationConfig()
STEEP = (0.8, -0.3, 1.0), 2.0  # normal and offset: 40 degrees off the optical axis


def plane(normal: tuple[float, float, float], offset: float) -> np.ndarray:
    """Depth image (H, W) of the plane normal . p = offset."""
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    rays = CAMERA.unproject(np.stack([u, v], -1), np.ones(u.shape))
    return (offset / (rays @ np.array(normal))).astype(np.float32)


def keypoints(count: int = 200) -> np.ndarray:
    """Sub-pixel places far enough inside that the window is whole."""
    return np.random.default_rng(0).uniform([4, 4], [155, 115], (count, 2)).astype(np.float32)


def test_points_lie_exactly_on_a_slanted_plane() -> None:
    normal, offset = STEEP
    points = lift(keypoints(), plane(*STEEP), CAMERA, CONFIG)
    # Inverse depth is affine on a plane, so only float32 of depth and result remains: 2^-23.
    np.testing.assert_allclose(points @ np.array(normal), offset, rtol=1e-6)


def test_a_point_lies_on_the_ray_of_its_keypoint() -> None:
    px = keypoints()
    points = lift(px, plane(*STEEP), CAMERA, CONFIG)
    np.testing.assert_allclose(CAMERA.project(points), px, atol=1e-4)  # float32 at 160 px


def test_holes_in_the_window_do_not_shift_the_plane() -> None:
    depth = plane(*STEEP)
    depth[np.random.default_rng(1).random(depth.shape) < 0.1] = 0
    points = lift(keypoints(), depth, CAMERA, CONFIG)
    good = np.isfinite(points[:, 2])
    assert good.mean() > 0.9
    np.testing.assert_allclose(points[good] @ np.array(STEEP[0]), STEEP[1], rtol=1e-6)


def test_a_window_with_little_depth_is_refused() -> None:
    depth = plane(*STEEP)
    depth[50:] = 0
    above, at, below = lift(np.array([[80, 47], [80, 49], [80, 52]]), depth, CAMERA, CONFIG)
    assert np.isfinite(above).all()  # 25 of 25 pixels
    assert np.isnan(below[2])  # none
    assert np.isfinite(at).all()  # 15 of 25 are 60 %
    assert np.isnan(lift(np.array([[80, 50]]), depth, CAMERA, CONFIG)[0, 2])  # 10 of 25


@pytest.mark.parametrize("into_window_px", [-1, 0, 1, 2])
def test_a_depth_edge_is_refused_wherever_it_crosses_the_window(into_window_px: int) -> None:
    # A step tilts the fitted plane and still leaves residuals of 0.4 of itself; beyond 4 sigma
    # is refused. 12 sigma is 12 mm at 0.63 m, and 0.43 m at 3 m.
    step = 12 * CONFIG.depth_sigma_per_m2
    depth = np.full((CAMERA.height, CAMERA.width), 2.0, np.float32)
    depth[:, 80 + into_window_px :] = 1 / (0.5 - step)
    assert np.isnan(lift(np.array([[80, 60]]), depth, CAMERA, CONFIG)[0, 2])


@pytest.mark.parametrize("beside_px", [3, 4])
def test_beside_a_depth_edge_the_narrow_window_gives_the_depth(beside_px: int) -> None:
    step = 12 * CONFIG.depth_sigma_per_m2
    depth = plane(*STEEP)
    depth[:, 80 + beside_px :] = 1 / (1 / depth[:, 80 + beside_px :] - step)
    points = lift(np.array([[80, 60]]), depth, CAMERA, CONFIG)
    np.testing.assert_allclose(points @ np.array(STEEP[0]), STEEP[1], rtol=1e-6)


def noisy(depth: np.ndarray, times: float) -> np.ndarray:
    """With so many times the noise of the settings."""
    sigma = times * CONFIG.depth_sigma_per_m2
    noise = np.random.default_rng(2).normal(0, sigma, depth.shape)
    return (1 / (1 / depth + noise)).astype(np.float32)


@pytest.mark.parametrize("times", [1.0, 2.0, 6.0])
def test_noise_of_the_sensor_is_no_edge_however_much_it_is(times: float) -> None:
    # The largest of 25 residuals exceeds 4 sigma in 25 * 6e-5 = 0.2 % of the narrow windows. The
    # noise that the smoothest quarter of the windows shows, of 81 pixels each, is 0.95 sigma.
    depth = noisy(plane(*STEEP), times)
    assert np.isfinite(lift(keypoints(), depth, CAMERA, CONFIG)[:, 2]).mean() > 0.98


@pytest.mark.parametrize("times", [1.0, 2.0])
def test_an_edge_is_refused_in_noise_too(times: float) -> None:
    # As above, of the noise that the image shows: its first windows lie on the edge, 15 do not.
    depth = np.full((CAMERA.height, CAMERA.width), 2.0, np.float32)
    depth[:, 80:] = 1 / (0.5 - 12 * times * CONFIG.depth_sigma_per_m2)
    beside = np.stack([np.full(100, 80.0), np.linspace(5, 114, 100)], 1)
    points = lift(beside, noisy(depth, times), CAMERA, CONFIG)
    assert np.isnan(points[:, 2]).mean() > 0.9


def test_an_image_full_of_edges_does_not_take_them_for_noise() -> None:
    depth = np.full((CAMERA.height, CAMERA.width), 2.0, np.float32)
    depth[:, 80:] = 1 / (0.5 - 12 * CONFIG.depth_sigma_per_m2 * (np.arange(80) // 5 % 2))
    edges = np.stack([np.full(100, 120.0), np.linspace(5, 114, 100)], 1)
    assert np.isnan(lift(edges, noisy(depth, 1.0), CAMERA, CONFIG)[:, 2]).all()


def test_the_window_averages_the_noise_of_the_sensor() -> None:
    # 81 pixels: a ninth of one pixel's noise in the middle, and the keypoint lies within half a
    # pixel of it, where slopes add little. Half as much again is far out for 200 of them, of which
    # one in 200 has the narrow window's fifth.
    sigma = CONFIG.depth_sigma_per_m2
    exact = plane(*STEEP)
    noise = np.random.default_rng(3).normal(0, sigma, exact.shape)
    depth = (1 / (1 / exact + noise)).astype(np.float32)
    points = lift(keypoints(), depth, CAMERA, CONFIG)
    truth = lift(keypoints(), exact, CAMERA, CONFIG)
    error = np.sqrt(np.nanmean((1 / points[:, 2] - 1 / truth[:, 2]) ** 2))
    assert error < 1.5 * sigma / 9


def test_a_keypoint_at_the_border_uses_what_is_inside() -> None:
    points = lift(np.array([[0.2, 60.3], [159, 60]]), plane(*STEEP), CAMERA, CONFIG)
    np.testing.assert_allclose(points @ np.array(STEEP[0]), STEEP[1], rtol=1e-6)


def test_a_corner_has_too_little_of_a_window() -> None:
    assert np.isnan(lift(np.array([[0, 0]]), plane(*STEEP), CAMERA, CONFIG)[0, 2])  # 9 of 25


def test_no_keypoints_give_no_points() -> None:
    assert lift(np.zeros((0, 2), np.float32), plane(*STEEP), CAMERA, CONFIG).shape == (0, 3)


def test_an_image_without_depth_gives_no_points() -> None:
    depth = np.zeros((CAMERA.height, CAMERA.width), np.float32)
    assert np.isnan(lift(keypoints(), depth, CAMERA, CONFIG)).all()
