import numpy as np
import pytest

from vnav.core import se3
from vnav.localisation.hypotheses.dlt import dlt, focal_of, poses_of


@pytest.fixture
def problem():
    """Sets of 8 points before cameras with K = I: poses, image points, world points."""
    rng = np.random.default_rng(0)
    R, t = se3.exp_so3(rng.normal(size=(50, 3))), rng.normal(size=(50, 3))
    points_camera = rng.uniform(-1, 1, (50, 8, 3)) + [0, 0, 3]
    points_world = (points_camera - t[:, None]) @ R
    return (
        np.concatenate([R, t[:, :, None]], 2),
        points_camera[..., :2] / points_camera[..., 2:],
        points_world,
    )


def test_six_points_give_the_pose_of_a_known_camera(problem):
    true, image, points = problem
    np.testing.assert_allclose(poses_of(dlt(image[:, :6], points[:, :6])), true, atol=1e-7)


def test_more_points_serve_too(problem):
    true, image, points = problem
    np.testing.assert_allclose(poses_of(dlt(image, points)), true, atol=1e-7)


def test_the_focal_length_of_an_unknown_camera_is_found(problem):
    _, image, points = problem
    P = dlt(image * 700 + [480, 360], points)
    np.testing.assert_allclose(focal_of(P), 700, rtol=1e-6)


def test_the_third_row_gives_the_depth(problem):
    true, image, points = problem
    P = dlt(image, points)
    depth = np.einsum("sj,spj->sp", P[:, 2, :3], points) + P[:, 2, 3:]
    np.testing.assert_allclose(depth.min(), 2, atol=0.7)  # points are 2 to 4 m away
    assert (depth > 0).all()


def test_points_in_one_plane_determine_no_camera(problem):
    true, _, points = problem
    flat = points * [1, 1, 0]
    seen = np.einsum("sij,spj->spi", true[:, :, :3], flat) + true[:, None, :, 3] + [0, 0, 20]
    P = dlt(seen[..., :2] / seen[..., 2:], flat)
    assert np.isnan(P).all()
    assert np.isnan(poses_of(P)).all()
