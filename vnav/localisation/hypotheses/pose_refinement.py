"""Non-linear refinement of a camera's pose, and of its focal length where unknown; compiled."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Array
from vnav.localisation.matches import Correspondences2D3D
from vnav.localisation.view import MIN_DEPTH_M, CameraPrior, View

MAX_ITERATIONS = 15
HUBER_SIGMAS = 1.5
CONVERGED = 1e-4  # relative gain of a step
ASSUMED_RESIDUALS = 20.0  # residuals that the assumed variances count for


@dataclass(frozen=True)
class RefinedPose:
    """A view, the information (6, 6) of its parameters, and how far residuals exceed it.

    Tangent of ``T_world_camera``, rotation first; (7, 7) with the log focal length. ``spread``:
    the residuals' variance over the one they were given.
    """

    view: View
    information: Array
    spread: float

    @property
    def covariance(self) -> Array:
        """Of the same parameters."""
        inverse = np.linalg.pinv(self.information, hermitian=True)
        return np.asarray(inverse * self.spread, float)


def refine_pose(view: View, matched: Correspondences2D3D, prior: CameraPrior) -> RefinedPose:
    """The most likely view near the given one, and its focal length unless exact (claim 4, 2.10).

    Levenberg-Marquardt on the reprojection errors under Huber's kernel. The covariance is the
    inverse information, scaled to what the residuals show of their variances: the more residuals
    there are, the less counts what was assumed.
    """
    damping = 1e-4
    H, g, cost = _with_prior(view, matched, prior)
    for _ in range(MAX_ITERATIONS):
        step = np.linalg.solve(H + damping * np.diag(H.diagonal() + 1e-12), g)
        trial = view.moved(np.asarray(-step, float))
        H_trial, g_trial, trial_cost = _with_prior(trial, matched, prior)
        if trial_cost > cost:
            damping *= 10
            continue
        converged = cost - trial_cost < CONVERGED * cost
        view, H, g, cost, damping = trial, H_trial, g_trial, trial_cost, damping / 10
        if converged:
            break
    freedom = max(0, 2 * len(matched.px) - len(H))
    return RefinedPose(view, H, (ASSUMED_RESIDUALS + cost) / (ASSUMED_RESIDUALS + freedom))


def _with_prior(
    view: View, matched: Correspondences2D3D, prior: CameraPrior
) -> tuple[Array, Array, float]:
    """Information matrix, gradient and cost of the correspondences and of the prior."""
    k = view.intrinsics
    camera = float(k.fx), float(k.fy), float(k.cx), float(k.cy)
    H, g, cost = _normal_equations(
        view.T_camera_world,
        camera,
        matched.points_world,
        matched.px,
        1 / np.sqrt(matched.variance_px2),
    )
    if prior.focal_sigma == 0:
        return H[:6, :6], g[:6], cost
    off = np.log(view.intrinsics.fx / prior.intrinsics.fx) / prior.focal_sigma
    H[6, 6] += prior.focal_sigma**-2
    g[6] += off / prior.focal_sigma
    return H, g, cost + off**2


@compiled
def _normal_equations(
    T: Array,
    camera: tuple[float, float, float, float],
    points: NDArray[np.float32],
    px: NDArray[np.float32],
    weight: Array,
) -> tuple[Array, Array, float]:
    """Information matrix (7, 7), gradient (7,) and cost, the focal length last.

    Each point is weighted by Huber's kernel; residuals are over their standard deviation.
    ``T_world_camera @ exp(xi)`` moves a point p in the camera by hat(p) rotation - translation.
    """
    H, g, cost = np.zeros((7, 7)), np.zeros(7), 0.0
    J_x, J_y = np.zeros(7), np.zeros(7)
    fx, fy, cx, cy = camera
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
        length = np.sqrt(r_x * r_x + r_y * r_y)
        near = min(length, HUBER_SIGMAS)
        huber = HUBER_SIGMAS / max(length, HUBER_SIGMAS)
        cost += near * (2 * length - near)
        for i in range(7):
            w_x, w_y = huber * J_x[i], huber * J_y[i]
            g[i] += w_x * r_x + w_y * r_y
            for j in range(7):
                H[i, j] += w_x * J_x[j] + w_y * J_y[j]
    return H, g, cost
