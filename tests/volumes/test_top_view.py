"""A cloud drawn from above."""

import numpy as np

from vnav.core.point_cloud import PointCloud
from vnav.volumes.top_view import BACKGROUND, seen_from_above


def floor() -> tuple[np.ndarray, np.ndarray]:
    """A floor of 10 x 20 points, one a pixel of 1 m, 200 grey."""
    x, y = np.meshgrid(np.arange(20), np.arange(10))
    points = np.stack([x.ravel(), y.ravel(), np.zeros(200)], 1).astype(np.float32)
    return points, np.full((200, 3), 200, np.uint8)


def test_rows_run_along_y_and_columns_along_x() -> None:
    assert seen_from_above(PointCloud(*floor()), 1.0).shape == (10, 20, 3)


def test_the_highest_point_is_seen() -> None:
    points, colors = floor()
    points = np.vstack([[[5, 5, 1]], points]).astype(np.float32)
    colors = np.vstack([[[255, 0, 0]], colors]).astype(np.uint8)
    image = seen_from_above(PointCloud(points, colors), 1.0)
    np.testing.assert_allclose(image[5, 5], [1, 0, 0])


def test_what_lies_beside_something_higher_is_darker() -> None:
    points, colors = floor()
    points[points[:, 0] == 8, 2] = 1
    image = seen_from_above(PointCloud(points, colors), 1.0)
    assert image[5, 7, 0] < image[5, 6, 0] == image[5, 8, 0]


def test_a_lone_hole_is_filled_and_a_large_one_is_not() -> None:
    points, colors = floor()
    lone = (points[:, :2] == (3, 3)).all(1)
    large = (np.abs(points[:, :2] - (12, 5)) <= 2).all(1)
    image = seen_from_above(PointCloud(points[~lone & ~large], colors[~lone & ~large]), 1.0)
    np.testing.assert_allclose(image[3, 3], 200 / 255)
    np.testing.assert_allclose(image[5, 12], BACKGROUND)


def test_one_point_is_one_pixel() -> None:
    cloud = PointCloud(np.zeros((1, 3)), np.full((1, 3), 255))
    assert seen_from_above(cloud, 1.0).shape == (1, 1, 3)
