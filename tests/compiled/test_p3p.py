import numpy as np

from vnav.compiled.p3p import p3p
from vnav.core import se3


def problems(count, rng):
    """Random poses ``T_camera_world`` (count, 3, 4), three points each, and their rays."""
    R, t = se3.exp_so3(rng.normal(size=(count, 3))), rng.normal(size=(count, 3))
    points_camera = rng.normal(size=(count, 3, 3))
    points_camera[..., 2] = np.abs(points_camera[..., 2]) + 0.5
    points_world = (points_camera - t[:, None]) @ R  # R^T p, row by row
    rays = points_camera / np.linalg.norm(points_camera, axis=2, keepdims=True)
    return np.concatenate([R, t[:, :, None]], 2), rays, points_world


def test_the_true_pose_is_among_the_solutions():
    true, rays, points = problems(200, np.random.default_rng(0))
    for k in range(200):
        found = p3p(rays[k : k + 1], points[k : k + 1])
        assert 1 <= len(found) <= 4
        assert np.abs(found - true[k]).max((1, 2)).min() < 1e-8


def test_every_solution_sends_the_points_onto_their_rays():
    _, rays, points = problems(100, np.random.default_rng(1))
    for k in range(100):
        for pose in p3p(rays[k : k + 1], points[k : k + 1]):
            seen = points[k] @ pose[:, :3].T + pose[:, 3]
            seen /= np.linalg.norm(seen, axis=1, keepdims=True)
            np.testing.assert_allclose(seen, rays[k], atol=1e-8)


def test_rotations_are_proper():
    _, rays, points = problems(100, np.random.default_rng(2))
    R = p3p(rays, points)[:, :, :3]
    np.testing.assert_allclose(
        R @ np.swapaxes(R, 1, 2), np.tile(np.eye(3), (len(R), 1, 1)), atol=1e-9
    )
    assert (np.linalg.det(R) > 0).all()


def test_points_on_a_line_have_no_solution():
    rays = np.array([[[0, 0, 1.0], [0.1, 0, 1], [0.2, 0, 1]]])
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    assert len(p3p(rays, np.array([[[0, 0, 2.0], [0.2, 0, 2], [0.4, 0, 2]]]))) == 0


def test_no_sets_have_no_solutions():
    assert p3p(np.zeros((0, 3, 3)), np.zeros((0, 3, 3))).shape == (0, 3, 4)
