"""Bundle adjustment of keyframes and landmarks: the optimum and its covariance; claim 3, S7."""

import gtsam
import numpy as np

from vnav.core.arrays import Array
from vnav.optimisation.bundle_graph import (
    BundleProblem,
    add_weak_priors,
    factor_graph,
    landmarks_first,
    point_key,
    pose_key,
)
from vnav.optimisation.sensor_model import Bundle

UNKNOWN_SIGMA = 1.0  # rad, m: of what nothing determines; all that is determined is far better
CONVERGED = 1e-3  # relative decrease of the error; a hundredth of it moves no pose by 0.1 mm


def adjust(
    initial: Bundle, problem: BundleProblem, iterations: int, tolerance: float = CONVERGED
) -> Bundle:
    """Poses and points that explain all observations best; the first camera stays where it is.

    With a prior on the cameras, none is fixed but by it; if the prior is fixed, only points move.
    A stereo factor with a virtual baseline gives depth noise that grows with depth squared;
    observations without depth are plain projections. Levenberg-Marquardt with a Cauchy kernel,
    until a step takes less than ``tolerance`` of the error; deterministic. Without observations
    and edges nothing moves.
    """
    if not len(problem.cameras):
        return initial
    graph, values = factor_graph(problem, initial)
    params = gtsam.LevenbergMarquardtParams()
    params.setMaxIterations(iterations)
    params.setRelativeErrorTol(tolerance)
    params.setOrdering(landmarks_first(problem))
    values = gtsam.LevenbergMarquardtOptimizer(graph, values, params).optimize()
    poses, points = initial.T_world_camera.copy(), initial.points_world.copy()
    for k in () if problem.prior and problem.prior.fixed else problem.cameras:
        poses[k] = values.atPose3(pose_key(k)).matrix()
    for n in problem.landmarks:
        points[n] = values.atPoint3(point_key(n))
    return Bundle(poses, points)


def covariances(bundle: Bundle, problem: BundleProblem) -> Array:
    """Marginal covariance (K, 6, 6) of each camera's tangent, rotation first; NaN if unseen.

    Relative to the first camera, which is fixed, or to the world of the prior; that of the prior
    itself where it is fixed. Where observations leave a pose or a point undetermined, each is held
    by `UNKNOWN_SIGMA`, which is what a pose then has in the directions that nothing tells.
    """
    cameras = len(bundle.T_world_camera)
    if problem.prior and problem.prior.fixed:
        return np.tile(np.diag(problem.prior.sigmas**2), (cameras, 1, 1))
    found = np.full((cameras, 6, 6), np.nan)
    if not len(problem.cameras):
        return found
    marginals = _marginals(problem, bundle)
    for k in problem.cameras:
        found[k] = marginals.marginalCovariance(pose_key(k))
    return found


def _marginals(problem: BundleProblem, bundle: Bundle) -> gtsam.Marginals:
    """Marginals at a bundle; of a singular system, with weak priors on all that it has."""
    graph, values = factor_graph(problem, bundle)
    try:
        return gtsam.Marginals(graph, values)
    except RuntimeError:  # gtsam's IndeterminateSystemException
        add_weak_priors(graph, problem, bundle, UNKNOWN_SIGMA)
        return gtsam.Marginals(graph, values)
