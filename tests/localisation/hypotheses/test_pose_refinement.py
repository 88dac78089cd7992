import dataclasses

import numpy as np
import pytest

from vnav.core import se3
from vnav.core.camera import CameraPrior, Intrinsics
from vnav.localisation.hypotheses.pose_refinement import RefinedPose, either, refine_pose
from vnav.localisation.matches import Correspondences2D3D
from vnav.localisation.view import View

CAMERA = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
EXACT, UNKNOWN = CameraPrior(CAMERA, 0.0), CameraPrior(CAMERA, np.inf)


def correspondences(view, rng, *, count=200, noise_px=1.0):
    points = rng.uniform([-2, -1.5, 2], [2, 1.5, 5], (count, 3))
    px, _ = view.project(points)
    return Correspondences2D3D(points, px + rng.normal(0, noise_px, px.shape), np.full(count, 1.0))


def off(view, true):
    T = view.T_camera_world @ se3.inverse(true.T_camera_world)
    return np.append(se3.log_so3(T[:3, :3]), T[:3, 3])


@pytest.fixture
def true():
    return View(se3.exp([0.02, -0.01, 0.03, 0.05, -0.02, 0.04]), CAMERA)


def test_without_noise_the_true_view_is_found(true):
    matched = correspondences(true, np.random.default_rng(0), noise_px=0.0)
    found = refine_pose(View(np.eye(4), CAMERA), matched, EXACT)
    np.testing.assert_allclose(off(found.view, true), 0, atol=1e-5)


def test_outliers_hardly_pull(true):
    """A tenth of the points 30 px off, all the same way: least squares would turn by 3 px."""
    rng = np.random.default_rng(1)
    matched = correspondences(true, rng)
    px = matched.px.copy()
    px[:20, 0] += 30
    found = refine_pose(true, dataclasses.replace(matched, px=px), EXACT)
    assert np.linalg.norm(off(found.view, true)[:3]) < 1 / 525  # a third of that


def test_the_covariance_is_the_scatter_of_the_result(true):
    """200 repetitions: a standard deviation is known to 5 %, so 20 % are four of its sigmas."""
    rng = np.random.default_rng(2)
    points = correspondences(true, rng, count=100).points_world
    px, _ = true.project(points)
    results = []
    for _ in range(200):
        matched = Correspondences2D3D(points, px + rng.normal(0, 1, px.shape), np.ones(100))
        results.append(refine_pose(true, matched, EXACT))
    scatter = np.std([off(r.view, true) for r in results], axis=0)
    estimated = np.sqrt(np.mean([np.diag(r.covariance) for r in results], axis=0))
    np.testing.assert_allclose(estimated, scatter, rtol=0.2)


def test_residuals_larger_than_their_variances_widen_the_covariance(true):
    rng = np.random.default_rng(3)
    matched = correspondences(true, rng, noise_px=3.0)
    honest = refine_pose(true, dataclasses.replace(matched, variance_px2=np.full(200, 9.0)), EXACT)
    understated = refine_pose(true, matched, EXACT)
    ratio = np.sqrt(np.trace(understated.covariance) / np.trace(honest.covariance))
    assert 0.7 < ratio < 1.1  # Huber's kernel counts large residuals less than their squares


def test_an_unknown_focal_length_is_found(true):
    long = dataclasses.replace(true, intrinsics=dataclasses.replace(CAMERA, fx=600.0, fy=600.0))
    matched = correspondences(long, np.random.default_rng(4))
    found = refine_pose(View(true.T_camera_world, CAMERA), matched, UNKNOWN)
    sigma = np.sqrt(found.covariance[6, 6])
    assert abs(np.log(found.view.intrinsics.fx / 600)) < 4 * sigma
    assert sigma < 0.01


def test_a_prior_holds_a_focal_length_that_the_points_leave_open(true):
    """Points in a plane that faces the camera: focal length and distance trade off."""
    rng = np.random.default_rng(5)
    points = rng.uniform([-1, -1, 3], [1, 1, 3.001], (50, 3))
    px, _ = true.project(points)
    matched = Correspondences2D3D(points, px + rng.normal(0, 0.5, px.shape), np.full(50, 0.25))
    found = refine_pose(View(np.eye(4), CAMERA), matched, CameraPrior(CAMERA, 0.02))
    assert abs(np.log(found.view.intrinsics.fx / 525)) < 4 * 0.02
    assert np.sqrt(found.covariance[6, 6]) < 0.021


def test_a_principal_point_that_may_be_anywhere_is_found(true):
    """A photo cut out of a larger one: its centre was at (100, 350)."""
    cropped = dataclasses.replace(true, intrinsics=dataclasses.replace(CAMERA, cx=100.0, cy=350.0))
    matched = correspondences(cropped, np.random.default_rng(6))
    anywhere = CameraPrior(CAMERA, np.inf, np.inf)
    found = refine_pose(View(true.T_camera_world, CAMERA), matched, anywhere)
    k, sigma = found.view.intrinsics, np.sqrt(np.diag(found.covariance))
    assert np.abs(off(found.view, cropped)).max() < 4 * sigma[:6].max()
    assert abs(k.cx - 100) < 4 * 640 * sigma[7]
    assert abs(k.cy - 350) < 4 * 640 * sigma[8]
    assert 640 * sigma[7:].max() < 20  # by 200 points of 1 px, a twentieth of the offset


@pytest.mark.parametrize("what", ["centre", "distortion"])
def test_what_the_camera_may_be_off_by_widens_the_covariance(true, what):
    """200 cameras, each a little off in what is not sought: as in the test of the scatter."""
    rng = np.random.default_rng(7)
    points = correspondences(true, rng, count=100).points_world
    x, y, z = (points @ true.T_camera_world[:3, :3].T + true.T_camera_world[:3, 3]).T
    rays = np.column_stack([x / z, y / z])
    px, _ = true.project(points)
    prior = CameraPrior(CAMERA, 0.0, **{f"{what}_sigma": 0.005})
    bend = 525 * rays * (rays**2).sum(1, keepdims=True)
    results = []
    for _ in range(200):
        wrong = {"centre": 640 * rng.normal(0, 0.005, 2), "distortion": bend * rng.normal(0, 0.005)}
        seen = px + wrong[what] + rng.normal(0, 1, px.shape)
        matched = Correspondences2D3D(points, seen, np.ones(100))
        results.append(refine_pose(true, matched, prior))
    scatter = np.std([off(r.view, true) for r in results], axis=0)
    estimated = np.sqrt(np.mean([np.diag(r.covariance) for r in results], axis=0))
    np.testing.assert_allclose(estimated, scatter, rtol=0.25)


def test_the_step_moves_the_view_as_its_tangent_says(true):
    xi = np.array([0.01, 0.02, -0.03, 0.1, -0.2, 0.3])
    expected = true.T_world_camera @ se3.exp(xi)
    np.testing.assert_allclose(true.moved(xi).T_world_camera, expected, atol=1e-12)


def known(parameters, variance=1e-6):
    """A pose that is found so well."""
    return RefinedPose(View(np.eye(4), CAMERA), variance * np.eye(parameters))


def test_a_pose_is_as_uncertain_as_another_is_likely_and_far():
    """One that is right with a probability of a fifth, 0.5 m to the right: 0.2 * 0.25 m2."""
    pose = known(7)
    other = RefinedPose(pose.view.moved(np.array([0, 0, 0, 0.5, 0, 0])), 4 * known(9).covariance)
    expected = 0.8 * pose.covariance + 0.2 * other.covariance[:7, :7]
    expected[3, 3] += 0.2 * 0.25
    np.testing.assert_allclose(either(pose, other, 0.2).covariance, expected, atol=1e-12)


def test_a_principal_point_is_as_uncertain_as_that_of_another_pose_is_far():
    """48 px to the right, of 640."""
    pose, camera = known(9), dataclasses.replace(CAMERA, cx=CAMERA.cx + 48)
    other = RefinedPose(View(np.eye(4), camera), pose.covariance)
    mixed = either(pose, other, 0.5).covariance
    np.testing.assert_allclose(mixed[7, 7], pose.covariance[7, 7] + 0.5 * (48 / 640) ** 2)


def test_what_another_pose_does_not_leave_open_stays_as_certain_as_it_was():
    """A principal point, where the other has none that was sought."""
    mixed = either(known(9), known(6, 1.0), 0.5).covariance
    np.testing.assert_allclose(mixed[6:, 6:], known(9).covariance[6:, 6:])
    np.testing.assert_allclose(mixed[:6, :6], 0.5 * (1 + 1e-6) * np.eye(6))


def test_a_pose_that_is_surely_right_stays_as_certain_as_it_was():
    far = RefinedPose(View(se3.exp([0, 1, 0, 3, 0, 0]), CAMERA), known(9).covariance)
    np.testing.assert_allclose(either(known(6), far, 0.0).covariance, known(6).covariance)
