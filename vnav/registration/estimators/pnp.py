"""Motion by reprojection of the first frame's 3D points: P3P in RANSAC, then 004 section 2.3.

The tangent is that of the source: it moves ``T_b_a`` from the left, translation first.
"""

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.compiled.p3p import p3p
from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import PoseEstimate, Rejected
from vnav.registration.compiled_geometry import MIN_Z_M, Point, exp, transform
from vnav.registration.correspondences import Correspondences
from vnav.registration.estimators.agreement import agreed
from vnav.registration.refinement import add_rows, carried_covariance, mirror, whiten

SAMPLE, CONFIDENCE = 3, 0.999
ROUNDS, ITERATIONS = 4, 10
CHI_SQUARED = 5.99  # 2 degrees of freedom: 95 % of the right matches
HUBER = np.sqrt(CHI_SQUARED)
CONVERGED = 1e-6  # rad and m
ROTATION_FIRST = [3, 4, 5, 0, 1, 2]


class PnpEstimator:
    """Asks the depth of the first frame alone; matches that have none there are left out."""

    def __init__(self, config: RegistrationConfig) -> None:
        self._config = config

    def estimate(
        self, correspondences: Correspondences, rng: np.random.Generator
    ) -> PoseEstimate | Rejected:
        """By RANSAC on P3P, then refined on the matches that agree."""
        seen = correspondences.reprojected
        if len(seen.points) < SAMPLE:
            return Rejected("no consistent motion", len(correspondences.matches))
        size = self._config.ransac_iterations, SAMPLE
        samples = rng.integers(len(seen.points), size=size)
        limit_px = self._config.ransac_threshold_px
        T_b_a = _consensus(samples, seen.points, seen.px, seen.cameras[1], limit_px)
        return self.refine(se3.inverse(T_b_a), correspondences)

    def refine(self, T_a_b: Array, correspondences: Correspondences) -> PoseEstimate | Rejected:
        """By Levenberg-Marquardt under Huber's kernel, four times, each on what then agrees."""
        seen = correspondences.reprojected
        T_b_a, H, squared = _refined(
            se3.inverse(T_a_b), seen.points, seen.px, seen.cameras, seen.variances
        )
        inlier = np.zeros(len(correspondences.matches), bool)
        inlier[np.flatnonzero(correspondences.of_a)[squared < CHI_SQUARED]] = True
        information = H[np.ix_(ROTATION_FIRST, ROTATION_FIRST)]  # T_a_b moves by minus the tangent
        T_a_b = se3.orthonormal(se3.inverse(T_b_a))
        return agreed(T_a_b, information, inlier, correspondences, self._config)


@compiled
def reprojection_jacobian(J: Array, p: Array | Point, camera: Array) -> None:
    """Derivative (2, 6) of minus the pixel of a point p in the camera: 004 eq 8 to 11.

    By a tangent at the left of the motion, translation first.
    """
    (X, Y, Z), fx, fy = p, camera[0], camera[1]
    w = 1 / Z
    J[0] = np.array([-fx * w, 0.0, fx * X * w * w, fx * X * Y * w * w, 0.0, fx * Y * w])
    J[0, 4] = -fx - fx * X * X * w * w
    J[1] = np.array([0.0, -fy * w, fy * Y * w * w, 0.0, -fy * X * Y * w * w, -fy * X * w])
    J[1, 3] = fy + fy * Y * Y * w * w


@compiled
def _consensus(
    samples: NDArray[np.intp], points: Array, px: Array, camera: Array, limit_px: float
) -> Array:
    """``T_b_a`` of P3P that most points (M, 3) agree with, by their pixels (M, 2)."""
    best, most, needed = np.eye(4), 0, float(len(samples))
    rays = np.ones((1, SAMPLE, 3))
    for trial in range(len(samples)):
        if trial >= needed:
            break
        rows = samples[trial]
        for k in range(SAMPLE):
            rays[0, k, 0] = (px[rows[k], 0] - camera[2]) / camera[0]
            rays[0, k, 1] = (px[rows[k], 1] - camera[3]) / camera[1]
            rays[0, k, 2] = 1.0
            rays[0, k] /= np.sqrt((rays[0, k] ** 2).sum())
        for pose in p3p(rays, points[rows].reshape(1, SAMPLE, 3)):
            count = _agreeing(pose, points, px, camera, limit_px)
            if count > most:
                best[:3], most = pose, count
                share = count / len(points)
                needed = np.log(1 - CONFIDENCE) / np.log(1 - share**SAMPLE + 1e-12)
    return best


@compiled
def _agreeing(pose: Array, points: Array, px: Array, camera: Array, limit_px: float) -> int:
    """How many points a pose (3, 4) projects to within a limit of their pixels."""
    count = 0
    for m in range(len(points)):
        p = transform(pose, points[m])
        if p[2] > MIN_Z_M:
            u = camera[0] * p[0] / p[2] + camera[2] - px[m, 0]
            v = camera[1] * p[1] / p[2] + camera[3] - px[m, 1]
            count += u * u + v * v < limit_px * limit_px
    return count


@compiled
def _refined(
    T_b_a: Array, points: Array, px: Array, cameras: Array, variances: Array
) -> tuple[Array, Array, Array]:
    """The refined motion, its normal matrix (6, 6), and squared residuals (M,) in sigmas."""
    T = T_b_a.copy()
    used = np.ones(len(points), np.bool_)
    squared, H = np.full(len(points), np.inf), np.zeros((6, 6))
    for _ in range(ROUNDS):
        T = _minimised(T, points, px, cameras, variances, used)
        H, _, _ = _normal_equations(T, points, px, cameras, variances, used, squared)
        used = squared < CHI_SQUARED
    return T, H, squared


@compiled
def _minimised(
    T: Array,
    points: Array,
    px: Array,
    cameras: Array,
    variances: Array,
    used: NDArray[np.bool_],
) -> Array:
    """Levenberg-Marquardt: 004 eq 6."""
    squared, damping = np.empty(len(points)), 1e-4
    H, g, cost = _normal_equations(T, points, px, cameras, variances, used, squared)
    for _ in range(ITERATIONS):
        step = -np.linalg.solve(H + damping * (np.diag(np.diag(H)) + 1e-9 * np.eye(6)), g)
        trial = exp(np.concatenate((step[3:], step[:3]))) @ T
        H_trial, g_trial, cost_trial = _normal_equations(
            trial, points, px, cameras, variances, used, squared
        )
        if cost_trial <= cost:
            T, H, g, cost, damping = trial, H_trial, g_trial, cost_trial, damping / 10
        else:
            damping *= 10
        if np.abs(step).max() < CONVERGED:
            break
    return T


@compiled
def _normal_equations(
    T: Array,
    points: Array,
    px: Array,
    cameras: Array,
    variances: Array,
    used: NDArray[np.bool_],
    squared: Array,
) -> tuple[Array, Array, float]:
    """Normal matrix (6, 6), gradient (6,) and cost of those used; fills ``squared`` of all.

    Residuals are in standard deviations of the pixel and of the point that is carried there.
    """
    H, g, cost = np.zeros((6, 6)), np.zeros(6), 0.0
    e, S, J = np.empty(3), np.empty((3, 3)), np.empty((3, 6))
    for m in range(len(points)):
        squared[m] = np.inf
        p = transform(T, points[m])
        if p[2] <= MIN_Z_M:
            continue
        there = cameras[1]
        e[0] = px[m, 0] - there[0] * p[0] / p[2] - there[2]
        e[1] = px[m, 1] - there[1] * p[1] / p[2] - there[3]
        reprojection_jacobian(J, p, there)
        carried_covariance(S, T, points[m], p, cameras[0], there, variances, variances[2])
        whiten(S, e, J, 2)
        squared[m] = e[0] * e[0] + e[1] * e[1]
        if not used[m]:
            continue
        length = np.sqrt(squared[m])
        near = min(length, HUBER)
        cost += near * (2 * length - near)
        weight = near / max(length, 1e-12)
        add_rows(H, g, J, e, weight, 2)
    mirror(H)
    return H, g, cost
