import dataclasses
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from vnav.core import se3
from vnav.core.camera import Camera, Intrinsics
from vnav.core.frame import Frame
from vnav.io.sources.rectify import Rectifier, rectified, resampled

UNITS = 10_000.0  # 0.1 mm, so that rounding of stored depth is far below what is tested
COLOR = Intrinsics(160, 120, 131.0, 131.0, 80.0, 60.0)
SENSOR = Intrinsics(160, 120, 146.0, 147.0, 79.0, 61.0)
T_COLOR_DEPTH = se3.exp([0.01, -0.02, 0.005, -0.03, 0.004, 0.002])
BARREL = (0.26, -0.95, -0.005, 0.003, 1.16)


def unregistered(color: Intrinsics = COLOR, sensor: Intrinsics = SENSOR) -> Camera:
    return Camera(color, UNITS, sensor, tuple(map(tuple, T_COLOR_DEPTH.tolist())))


def pixels(camera: Intrinsics) -> NDArray[np.float64]:
    columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    return np.stack([columns, rows], -1).astype(float)


def depth_of_plane(
    camera: Intrinsics, normal: NDArray[np.float64], distance: float
) -> NDArray[np.float64]:
    """Depth (H, W) of the plane normal . point = distance, both in this camera's coordinates."""
    rays = camera.unproject(pixels(camera), np.ones((camera.height, camera.width)))
    return distance / (rays @ normal)


def stored(depth_m: NDArray[np.float64]) -> NDArray[np.uint16]:
    return np.where(abs(depth_m - 3) < 3, np.rint(depth_m * UNITS), 0).astype(np.uint16)


def seen_by_sensor(camera: Camera, depth_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where (H, W, 2) in the depth image the points of colour pixels with these depths lie."""
    assert camera.depth is not None
    points_color = camera.color.unproject(pixels(camera.color), depth_m)
    points_depth = se3.transform(se3.inverse(camera.T_color_depth), points_color.reshape(-1, 3))
    return camera.depth.project(points_depth).reshape(*depth_m.shape, 2)


def test_what_is_rectified_keeps_its_pinhole_and_loses_its_distortion() -> None:
    camera = Camera(Intrinsics(640, 480, 517.0, 516.0, 318.0, 255.0, BARREL), 5000.0)
    assert rectified(camera) == Intrinsics(640, 480, 517.0, 516.0, 318.0, 255.0)


def test_undistorted_dots_lie_where_a_pinhole_sees_them() -> None:
    pinhole = Intrinsics(640, 480, 517.3, 516.5, 318.6, 255.3)
    camera = Camera(Intrinsics(*pinhole.size, 517.3, 516.5, 318.6, 255.3, BARREL), 5000.0)
    points = np.array([[x, y, 1.0] for x in (-0.4, 0.1, 0.45) for y in (-0.35, 0.05, 0.3)])
    distorted = cv2.projectPoints(points, np.zeros(3), np.zeros(3), pinhole.K, np.array(BARREL))[0]
    squared = ((pixels(pinhole)[:, :, None] - distorted[:, 0]) ** 2).sum(-1)
    dots = (255 * np.exp(-squared / 18).sum(-1)).astype(np.uint8)
    image = Rectifier(camera).color(np.repeat(dots[..., None], 3, 2))[..., 0].astype(float)
    for expected in pinhole.project(points):
        near = ((pixels(pinhole) - expected) ** 2).sum(-1) < 12**2
        weight = image * near
        found = (pixels(pinhole) * weight[..., None]).sum((0, 1)) / weight.sum()
        # The centroid of a dot of 255 grey levels; the lens stretches it by some per cent across
        # 12 px, which moves its centroid by a part of a pixel, against 4 to 18 px of distortion.
        assert np.linalg.norm(found - expected) < 0.3


def test_undistortion_takes_depth_from_one_pixel_and_never_mixes_two() -> None:
    camera = Camera(Intrinsics(160, 120, 131.0, 131.0, 80.0, 60.0, BARREL), 1000.0)
    raw = np.random.default_rng(0).choice(np.array([0, 1000, 3000], np.uint16), (120, 160))
    assert set(np.unique(Rectifier(camera).depth_m(raw))) == {0, np.float32(1), np.float32(3)}


def test_undistorted_depth_lies_on_undistorted_colour() -> None:
    camera = Camera(Intrinsics(160, 120, 131.0, 131.0, 80.0, 60.0, BARREL), 1000.0)
    raw = np.full((120, 160), 1000, np.uint16)
    raw[30:90, 40:120] = 2000
    color = np.repeat((raw // 10).astype(np.uint8)[..., None], 3, 2)
    rectifier = Rectifier(camera)
    far_by_depth = rectifier.depth_m(raw) > 1.5
    far_by_color = rectifier.color(color)[..., 0] > 150
    seen = rectifier.depth_m(raw) > 0
    # They may differ only where colour is interpolated: on the square's outline of 280 px.
    assert (far_by_depth != far_by_color)[seen].sum() < 140
    assert far_by_depth.sum() > 4000


def test_registered_depth_is_only_scaled() -> None:
    raw = np.array([[0, 1, 1000], [2500, 65534, 65535]], np.uint16)
    camera = Camera(Intrinsics(3, 2, 2.0, 2.0, 1.0, 0.5), 1000.0)
    depth_m = Rectifier(camera).depth_m(raw)
    assert depth_m.dtype == np.float32
    np.testing.assert_allclose(depth_m, [[0, 0.001, 1], [2.5, 65.534, 0]], rtol=1e-6)


@pytest.mark.parametrize("slant_deg", [0.0, 45.0, 65.0])
def test_a_plane_is_registered_more_finely_than_a_pixel(slant_deg: float) -> None:
    camera = unregistered()
    slant = np.deg2rad(slant_deg)
    normal = np.array([np.sin(slant), 0.1, np.cos(slant)])
    registered = Rectifier(camera).depth_m(stored(depth_of_plane(SENSOR, normal, 1.5)))
    normal_color = T_COLOR_DEPTH[:3, :3] @ normal
    expected = depth_of_plane(COLOR, normal_color, 1.5 + normal_color @ T_COLOR_DEPTH[:3, 3])
    there = registered > 0
    assert there.mean() > 0.4
    inside = there.copy()
    inside[0], inside[-1], inside[:, 0], inside[:, -1] = (False,) * 4
    inside &= cv2.erode(there.astype(np.uint8), np.ones((3, 3))) > 0
    # Stored depth is rounded to 0.05 mm, interpolation averages it; float32 adds 1e-6 of 3 m.
    # Rounding to the nearest pixel would be off by half a pixel: 12 mm at 65 degrees.
    assert np.abs(registered - expected)[inside].max() < 1e-4


@pytest.mark.parametrize("enlarged", [1, 3])
def test_registration_leaves_no_pixel_of_a_surface_empty(enlarged: int) -> None:
    color = COLOR.scaled(160 * enlarged, 120 * enlarged)
    camera = unregistered(color)
    depth_m = depth_of_plane(SENSOR, np.array([0.5, 0.1, 0.8]), 1.5)
    registered = Rectifier(camera).depth_m(stored(depth_m))
    expected = depth_of_plane(
        color,
        T_COLOR_DEPTH[:3, :3] @ [0.5, 0.1, 0.8],
        1.5 + T_COLOR_DEPTH[:3, :3] @ [0.5, 0.1, 0.8] @ T_COLOR_DEPTH[:3, 3],
    )
    source = seen_by_sensor(camera, expected)
    seen = ((source > 0) & (source < np.array(SENSOR.size) - 1)).all(-1)
    assert seen.mean() > 0.6
    assert (registered[seen] > 0).all()


def test_a_grazing_plane_has_no_gaps_in_a_sensor_of_few_pixels() -> None:
    # At 75 degrees, neighbouring pixels of this sensor differ by tan(75) / 66 = 5.7 % of the depth.
    coarse = unregistered(sensor=SENSOR.scaled(72, 54))
    normal = np.array([0.0, np.sin(np.deg2rad(75)), -np.cos(np.deg2rad(75))])
    raw = stored(depth_of_plane(coarse.depth, normal, -0.4))
    found = Rectifier(coarse).depth_m(raw)
    assert (found[20:40, 20:140] > 0).all()


def test_a_hole_in_the_depth_image_stays_a_hole() -> None:
    camera = unregistered()
    raw = stored(depth_of_plane(SENSOR, np.array([0, 0, 1.0]), 2.0))
    raw[40:70, 50:90] = 0
    registered = Rectifier(camera).depth_m(raw)
    source = seen_by_sensor(camera, np.full((120, 160), 2.0 + T_COLOR_DEPTH[2, 3]))
    hole = ((source > [50, 40]) & (source < [89, 69])).all(-1)
    assert hole.sum() > 500
    assert not registered[hole].any()


def test_what_is_near_hides_what_is_far() -> None:
    camera = unregistered()
    raw = stored(depth_of_plane(SENSOR, np.array([0, 0, 1.0]), 3.0))
    raw[40:80, 60:100] = 0.8 * UNITS
    registered = Rectifier(camera).depth_m(raw)
    points = SENSOR.unproject(pixels(SENSOR)[40:80, 60:100].reshape(-1, 2), np.full(1600, 0.8))
    points_color = se3.transform(T_COLOR_DEPTH, points)
    left_top, right_bottom = (COLOR.project(points_color[k]) for k in (0, -1))
    inside = ((pixels(COLOR) > left_top + 1) & (pixels(COLOR) < right_bottom - 1)).all(-1)
    assert inside.sum() > 800
    np.testing.assert_allclose(registered[inside], 0.8, atol=0.03)  # the camera is turned a little
    # Nothing lies between the two: a jump in depth is not bridged.
    assert not ((registered > 0.9) & (registered < 2.8)).any()


def test_a_lone_measurement_is_kept_at_its_nearest_pixel() -> None:
    camera = unregistered()
    raw = np.zeros((120, 160), np.uint16)
    raw[50, 70] = 1.5 * UNITS
    registered = Rectifier(camera).depth_m(raw)
    point = se3.transform(T_COLOR_DEPTH, SENSOR.unproject([[70, 50]], [1.5]))
    column, row = np.rint(COLOR.project(point)[0]).astype(int)
    assert np.argwhere(registered).tolist() == [[row, column]]
    assert registered[row, column] == pytest.approx(point[0, 2], abs=1e-5)


def test_threads_get_the_same_bytes() -> None:
    rng = np.random.default_rng(3)
    rectifier = Rectifier(unregistered())
    raw = stored(
        depth_of_plane(SENSOR, np.array([0.5, 0.1, 0.8]), 1.5) + rng.normal(0, 0.01, (120, 160))
    )
    alone = rectifier.depth_m(raw)
    with ThreadPoolExecutor(8) as pool:
        assert all((other == alone).all() for other in pool.map(rectifier.depth_m, [raw] * 32))


def seen_plane(camera: Intrinsics) -> Frame:
    """A slanted plane with a pattern that is smooth over the camera's rays."""
    rays = camera.unproject(pixels(camera), np.ones((camera.height, camera.width)))
    grey = 128 + 60 * np.sin(9 * rays[..., 0]) + 60 * np.cos(7 * rays[..., 1])
    depth_m = depth_of_plane(camera, np.array([0.3, 0.1, 1.0]), 2.0).astype(np.float32)
    color = np.repeat(np.rint(grey).astype(np.uint8)[..., None], 3, 2)
    return Frame(0, 4, 1.5, color, depth_m, camera)


def test_a_frame_of_the_wanted_camera_is_not_touched() -> None:
    frame = seen_plane(COLOR)
    assert resampled(frame, Intrinsics(160, 120, 131.0, 131.0, 80.0, 60.0)) is frame


@pytest.mark.parametrize("other", [Intrinsics(160, 120, 144.0, 143.0, 77.0, 63.0), SENSOR])
def test_a_frame_of_another_focal_length_is_seen_as_the_wanted_camera_sees_it(
    other: Intrinsics,
) -> None:
    frame, expected = resampled(seen_plane(other), COLOR), seen_plane(COLOR)
    assert (frame.index, frame.stamp_s, frame.intrinsics) == (4, 1.5, COLOR)
    there = frame.depth_m > 0
    assert 0.7 < there.mean() < 1
    # Rounding to grey levels three times, and linear interpolation of the pattern: its second
    # derivative, at most 60 * (9 / 131)^2, over 8. A pixel's shift would be 4 grey levels. On the
    # outline colour lies up to half a pixel beyond the image.
    inside = cv2.erode(there.astype(np.uint8), np.ones((3, 3))) > 0
    off = np.abs(frame.color.astype(int) - expected.color)[inside]
    assert off.max() <= 1
    # The nearest pixel is at most half a pixel away, in x and y.
    step_m = np.abs(np.gradient(expected.depth_m)).sum(0).max()
    assert np.abs(frame.depth_m - expected.depth_m)[there].max() < 0.5 * step_m * 1.1


def test_beyond_the_image_there_is_no_depth_and_colour_repeats_its_border() -> None:
    narrow = COLOR.scaled(320, 240)  # twice the focal length: half the view, cut to its middle
    narrow = Intrinsics(160, 120, narrow.fx, narrow.fy, 79.5, 59.5)
    frame = resampled(seen_plane(narrow), COLOR)
    assert not frame.depth_m[:28].any()
    np.testing.assert_array_equal(frame.color[0], frame.color[20])
    assert (frame.depth_m > 0).mean() == pytest.approx(0.25, abs=0.02)


def test_what_is_hidden_stays_where_it_was_seen() -> None:
    narrow = COLOR.scaled(320, 240)
    narrow = Intrinsics(160, 120, narrow.fx, narrow.fy, 79.5, 59.5)
    hidden = np.zeros((120, 160), bool)
    hidden[:60] = True
    frame = resampled(dataclasses.replace(seen_plane(narrow), hidden=hidden), COLOR)
    # The upper half of the narrow view, and nothing beyond it.
    np.testing.assert_array_equal(frame.hidden[:60], frame.depth_m[:60] > 0)
    assert not frame.hidden[60:].any()
