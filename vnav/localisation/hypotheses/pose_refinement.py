"""Non-linear refinement of a camera's pose, and of its intrinsics where unknown; compiled."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import CameraPrior
from vnav.localisation.matches import Correspondences2D3D
from vnav.localisation.view import MIN_DEPTH_M, View

MAX_ITERATIONS = 15
HUBER_SIGMAS = 1.5
CONVERGED = 1e-4  # relative gain of a step
EXACT = 1e-6  # standard deviation of what is known, where other parameters are not
ANYWHERE = 0.3  # that of an unknown principal point, over the longer side of the image
BENT = 2.0  # times as far as its matches tell, such a point follows what bends the map
ASSUMED_RESIDUALS = 20.0  # residuals that the assumed variances count for


@dataclass(frozen=True)
class RefinedPose:
    """A view, and the covariance (6, 6) of its parameters.

    Tangent of ``T_world_camera``, rotation first; (7, 7) with the log focal length, (9, 9) with
    the principal point, as in `View.moved`.
    """

    view: View
    covariance: Array


def refine_pose(view: View, matched: Correspondences2D3D, prior: CameraPrior) -> RefinedPose:
    """The most likely view near the given one, and what is unknown of its camera (claim 4, 2.10).

    Levenberg-Marquardt on the reprojection errors under Huber's kernel. The covariance is the
    inverse information, scaled to what the residuals show of their variances: the more residuals
    there are, the less counts what was assumed. What is roughly known of the camera beside its
    focal length is not sought, as small errors of the map would move it: what it may be off by is
    added to the covariance (Schmidt's considered parameters).
    """
    free, damping = _parameters(prior), 1e-4
    H, g, cost = _with_prior(view, matched, prior)
    for _ in range(MAX_ITERATIONS):
        step = np.linalg.solve(
            H[:free, :free] + damping * np.diag(H.diagonal()[:free] + 1e-12), g[:free]
        )
        trial = view.moved(np.asarray(-step, float))
        H_trial, g_trial, trial_cost = _with_prior(trial, matched, prior)
        if trial_cost > cost:
            damping *= 10
            continue
        converged = cost - trial_cost < CONVERGED * cost
        view, H, g, cost, damping = trial, H_trial, g_trial, trial_cost, damping / 10
        if converged:
            break
    freedom = max(0, 2 * len(matched.px) - free)
    spread = (ASSUMED_RESIDUALS + cost) / (ASSUMED_RESIDUALS + freedom)
    return RefinedPose(view, _covariance(H, spread, prior))


def either(pose: RefinedPose, other: RefinedPose, share: float) -> RefinedPose:
    """A pose as uncertain as it is where another is right with a probability, the share."""
    n = min(len(pose.covariance), len(other.covariance))
    T = se3.inverse(pose.view.T_world_camera) @ other.view.T_world_camera
    ours, theirs = pose.view.intrinsics, other.view.intrinsics
    centre = np.array([theirs.cx - ours.cx, theirs.cy - ours.cy]) / max(ours.size)
    off = np.array([*se3.deviation(T), np.log(theirs.fx / ours.fx), *centre])[:n]
    about_pose = other.covariance[:n, :n] + np.outer(off, off)
    mixed = pose.covariance.copy()
    mixed[:n, :n] = (1 - share) * mixed[:n, :n] + share * about_pose
    return RefinedPose(pose.view, mixed)


def _parameters(prior: CameraPrior) -> int:
    """How many of the parameters of `View.moved` are sought."""
    if np.isinf(prior.centre_sigma):
        return 9
    return 6 if prior.focal_sigma == 0 else 7


def _covariance(H: Array, spread: float, prior: CameraPrior) -> Array:
    """Of the parameters sought, by the information of all."""
    free, centre = _parameters(prior), prior.centre_sigma
    found = np.linalg.pinv(H[:free, :free], hermitian=True)
    sigma = np.array([prior.focal_sigma, centre, centre, prior.distortion_sigma])
    moved = found @ H[:free, free:] * sigma[free - 6 : len(H) - 6]
    bent = BENT**2 if free == 9 else 1.0
    return np.asarray(bent * spread * found + moved @ moved.T, float)


def _with_prior(
    view: View, matched: Correspondences2D3D, prior: CameraPrior
) -> tuple[Array, Array, float]:
    """Information matrix, gradient and cost of the correspondences and of the prior."""
    k, known = view.intrinsics, prior.intrinsics
    side = float(max(k.size))
    H, g, cost = _normal_equations(
        view.T_camera_world,
        (float(k.fx), float(k.fy), float(k.cx), float(k.cy), side),
        matched.points_world,
        matched.px,
        1 / np.sqrt(matched.variance_px2),
        6 if prior.is_exact else 10,
    )
    if prior.is_exact:
        return H, g, cost
    off = np.array([np.log(k.fx / known.fx), (k.cx - known.cx) / side, (k.cy - known.cy) / side])
    information = np.array([max(prior.focal_sigma, EXACT), ANYWHERE, ANYWHERE]) ** -2.0
    H[range(6, 9), range(6, 9)] += information
    g[6:9] += information * off
    return H, g, cost + float(information @ off**2)


@compiled
def _normal_equations(
    T: Array,
    camera: tuple[float, float, float, float, float],
    points: NDArray[np.float32],
    px: NDArray[np.float32],
    weight: Array,
    parameters: int,
) -> tuple[Array, Array, float]:
    """Information matrix, gradient and cost of the first of ten parameters.

    They are those of `View.moved` and the first coefficient of radial distortion. Each point is
    weighted by Huber's kernel; residuals are over their standard deviation.
    ``T_world_camera @ exp(xi)`` moves a point p in the camera by hat(p) rotation - translation.
    """
    H, g, cost = np.zeros((parameters, parameters)), np.zeros(parameters), 0.0
    J_x, J_y = np.zeros(10), np.zeros(10)
    fx, fy, cx, cy, side = camera
    for m in range(len(points)):
        X, Y, Z = points[m]
        depth = T[2, 0] * X + T[2, 1] * Y + T[2, 2] * Z + T[2, 3]
        inverse_z = 1 / max(depth, MIN_DEPTH_M)
        x = (T[0, 0] * X + T[0, 1] * Y + T[0, 2] * Z + T[0, 3]) * inverse_z
        y = (T[1, 0] * X + T[1, 1] * Y + T[1, 2] * Z + T[1, 3]) * inverse_z
        r_x = (fx * x + cx - px[m, 0]) * weight[m]
        r_y = (fy * y + cy - px[m, 1]) * weight[m]
        u, v = fx * weight[m], fy * weight[m]
        J_x[0], J_x[1], J_x[2] = x * y * u, (-1 - x * x) * u, y * u
        J_y[0], J_y[1], J_y[2] = (1 + y * y) * v, -x * y * v, -x * v
        J_x[3], J_x[5], J_x[6] = -inverse_z * u, x * inverse_z * u, x * u
        J_y[4], J_y[5], J_y[6] = -inverse_z * v, y * inverse_z * v, y * v
        J_x[7], J_y[8] = side * weight[m], side * weight[m]
        J_x[9], J_y[9] = (x * x + y * y) * x * u, (x * x + y * y) * y * v
        length = np.sqrt(r_x * r_x + r_y * r_y)
        near = min(length, HUBER_SIGMAS)
        huber = HUBER_SIGMAS / max(length, HUBER_SIGMAS)
        cost += near * (2 * length - near)
        for i in range(parameters):
            w_x, w_y = huber * J_x[i], huber * J_y[i]
            g[i] += w_x * r_x + w_y * r_y
            for j in range(parameters):
                H[i, j] += w_x * J_x[j] + w_y * J_y[j]
    return H, g, cost
