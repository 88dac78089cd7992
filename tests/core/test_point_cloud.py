"""Clouds and meshes as values."""

import numpy as np
import pytest

from vnav.core.point_cloud import Mesh, PointCloud


def test_arrays_are_typed_and_read_only() -> None:
    cloud = PointCloud(np.zeros((2, 3)), np.zeros((2, 3)))
    assert cloud.points_world.dtype == np.float32
    assert cloud.colors.dtype == np.uint8
    with pytest.raises(ValueError, match="read-only"):
        cloud.points_world[0] = 1


def test_as_many_colours_as_points() -> None:
    with pytest.raises(ValueError, match="shape"):
        PointCloud(np.zeros((2, 3)), np.zeros((1, 3)))


def test_as_many_normals_as_vertices() -> None:
    with pytest.raises(ValueError, match="shape"):
        Mesh(np.zeros((2, 3)), np.zeros((1, 3)), np.zeros((2, 3)), np.zeros((0, 3)))
