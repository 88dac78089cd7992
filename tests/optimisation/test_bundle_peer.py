"""Bundle adjustment, held against gtsam's: the same optimum and the same covariances."""

from typing import Any

import gtsam
import numpy as np

from tests.optimisation.test_bundle import CAMERAS, MODEL, disturbed, measured, scene, without_depth
from vnav.core import se3
from vnav.core.frame import Edge
from vnav.optimisation import bundle
from vnav.optimisation.bundle_problem import FIXED_SIGMA, BundleProblem
from vnav.optimisation.sensor_model import CAUCHY_SIGMAS, Bundle, SensorModel

BASELINE_M = 0.1  # turns inverse depth into the disparity that gtsam measures
POINT = 1000  # key of the first one


def peer_graph(problem: BundleProblem, start: Bundle) -> tuple[Any, Any]:
    """The problem and its start as gtsam has them."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for k, T in enumerate(start.T_world_camera):
        values.insert(k, gtsam.Pose3(T))
    for n, point in enumerate(start.points_world):
        values.insert(POINT + n, point)
    fixed = gtsam.noiseModel.Isotropic.Sigma(6, FIXED_SIGMA)
    graph.add(gtsam.PriorFactorPose3(0, gtsam.Pose3(start.T_world_camera[0]), fixed))
    for e in problem.edges:
        noise = gtsam.noiseModel.Gaussian.Information(e.information)
        graph.add(gtsam.BetweenFactorPose3(e.i, e.j, gtsam.Pose3(e.T_i_j), noise))
    seen, model = problem.seen, problem.model
    columns = seen.camera.tolist(), seen.landmark.tolist(), seen.px, seen.inverse_depth
    for camera, landmark, px, inverse in zip(*columns, strict=True):
        graph.add(peer_factor(camera, POINT + landmark, px, inverse, model))
    return graph, values


def peer_factor(camera: int, point: int, px: np.ndarray, inverse: float, model: SensorModel) -> Any:
    """A stereo factor; without depth a projection."""
    lens, (u, v) = model.intrinsics[camera], px
    cauchy = gtsam.noiseModel.mEstimator.Cauchy.Create(CAUCHY_SIGMAS)
    if np.isnan(inverse):
        pixel = gtsam.noiseModel.Isotropic.Sigma(2, model.pixel_sigma)
        noise = gtsam.noiseModel.Robust.Create(cauchy, pixel)
        mono = gtsam.Cal3_S2(lens.fx, lens.fy, 0, lens.cx, lens.cy)
        return gtsam.GenericProjectionFactorCal3_S2(px, noise, camera, point, mono)
    left, of_disparity = model.pixel_sigma**2, (lens.fx * BASELINE_M * model.depth_sigma) ** 2
    covariance = np.array([[left, left, 0], [left, left + of_disparity, 0], [0, 0, left]])
    noise = gtsam.noiseModel.Robust.Create(cauchy, gtsam.noiseModel.Gaussian.Covariance(covariance))
    stereo = gtsam.Cal3_S2Stereo(lens.fx, lens.fy, 0, lens.cx, lens.cy, BASELINE_M)
    both = gtsam.StereoPoint2(u, u - lens.fx * BASELINE_M * inverse, v)
    return gtsam.GenericStereoFactor3D(both, noise, camera, point, stereo)


def peer_problem() -> tuple[BundleProblem, Bundle]:
    """Noisy, some of it wrong or without depth, with edges that disagree."""
    rng = np.random.default_rng(0)
    truth = scene(rng)
    seen = without_depth(measured(truth, rng), np.arange(0, 300, 3))
    seen.px[::40] += 30
    T = truth.T_world_camera @ se3.exp(1e-3 * rng.standard_normal((CAMERAS, 6)))
    edges = [Edge(k, k + 2, se3.inverse(T[k]) @ T[k + 2], 1e4 * np.eye(6)) for k in (0, 3)]
    return BundleProblem(seen, edges, MODEL), disturbed(truth, rng)


def test_gtsam_finds_the_same_optimum_and_covariances() -> None:
    # Both stop where a step gains nothing; sigmas are 1e-3 and more. gtsam takes the derivative of
    # an edge where it agrees: to 1e-3.
    problem, start = peer_problem()
    graph, values = peer_graph(problem, start)
    params = gtsam.LevenbergMarquardtParams()
    params.setRelativeErrorTol(0.0)
    params.setAbsoluteErrorTol(0.0)
    best = gtsam.LevenbergMarquardtOptimizer(graph, values, params).optimize()
    found = bundle.adjust(start, problem, 100, tolerance=0.0)
    poses = np.array([best.atPose3(k).matrix() for k in range(CAMERAS)])
    points = np.array([best.atPoint3(POINT + n) for n in range(len(found.points_world))])
    np.testing.assert_allclose(found.T_world_camera, poses, atol=1e-6)
    np.testing.assert_allclose(found.points_world, points, atol=1e-5)
    marginals = gtsam.Marginals(graph, best)
    expected = np.array([marginals.marginalCovariance(k) for k in range(CAMERAS)])
    covariance = bundle.covariances(Bundle(poses, points), problem)
    np.testing.assert_allclose(covariance, expected, rtol=1e-3, atol=1e-9)
