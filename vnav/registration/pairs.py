"""Matches as residuals in standard deviations; compiled, since every frame sums them often."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.mapping import Keyframe

Array = NDArray[np.float64]
NEAREST_M = 0.05  # nothing is seen nearer than this
CAUCHY_SIGMAS = 2.0


class Pairs:
    """M matches: a's 3D points, seen in b as pixel and, where b has depth, inverse depth."""

    def __init__(
        self,
        a: Keyframe,
        b: Keyframe,
        matches: NDArray[np.int32],
        intrinsics: Intrinsics,
        config: RegistrationConfig,
    ) -> None:
        self.points_a = a.points_camera[matches[:, 0]].astype(float)
        self.points_b = b.points_camera[matches[:, 1]].astype(float)
        self.px_b = b.features.keypoints_px[matches[:, 1]].astype(float)
        self.camera = np.array([intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy])
        self.sigmas = np.array([config.pixel_sigma_px, config.depth_sigma_per_m2])

    @property
    def both(self) -> NDArray[np.bool_]:
        """Which matches (M,) have depth at both ends."""
        return np.asarray(np.isfinite(self.points_b[:, 2]))

    def costs(self, T_a_b: Array, threshold_sigmas: float) -> tuple[Array, NDArray[np.int64]]:
        """Truncated squared residuals summed (S,) for motions (S, 4, 4), and their inliers (S,).

        In units of the threshold, so that 1 is where an inlier ends; only b's own noise counts.
        """
        T_b_a = np.ascontiguousarray(se3.inverse(T_a_b))
        limits = np.repeat(self.sigmas, (2, 1)) * threshold_sigmas
        cost, inliers = _costs(T_b_a, self.points_a, self.points_b, self.px_b, self.camera, limits)
        return cost, inliers

    def normal_equations(self, T_a_b: Array) -> tuple[Array, Array, Array]:
        """Gauss-Newton matrix (6, 6), gradient (6,) and squared residuals (M,) at one motion.

        Residuals are in standard deviations of both measurements: b's own, and a's carried over by
        the motion; the sums are weighted by a Cauchy kernel. Infinite behind b.
        """
        T_b_a = np.ascontiguousarray(se3.inverse(T_a_b))
        variances = np.repeat(self.sigmas, (2, 1)) ** 2
        H, g, squared = _normal_equations(
            T_b_a, self.points_a, self.points_b, self.px_b, self.camera, variances
        )
        return H, g, squared

    def rms_px(self, T_a_b: Array, chosen: NDArray[np.bool_]) -> float:
        """Root mean square reprojection error of the chosen matches."""
        p = se3.transform(se3.inverse(T_a_b), self.points_a[chosen])
        off = self.camera[:2] * p[:, :2] / p[:, 2:] + self.camera[2:] - self.px_b[chosen]
        return float(np.sqrt((off**2).sum(1).mean()))


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _costs(
    T_b_a: Array,
    points_a: Array,
    points_b: Array,
    px_b: Array,
    camera: Array,
    limits: Array,
) -> tuple[Array, NDArray[np.int64]]:
    count = len(T_b_a)
    cost, inliers = np.zeros(count), np.zeros(count, np.int64)
    fx, fy, cx, cy = camera
    for s in range(count):
        T = T_b_a[s]
        for m in range(len(points_a)):
            X, Y, Z = points_a[m]
            z = T[2, 0] * X + T[2, 1] * Y + T[2, 2] * Z + T[2, 3]
            squared = 1.0
            if z > NEAREST_M:
                x = T[0, 0] * X + T[0, 1] * Y + T[0, 2] * Z + T[0, 3]
                y = T[1, 0] * X + T[1, 1] * Y + T[1, 2] * Z + T[1, 3]
                u = (fx * x / z + cx - px_b[m, 0]) / limits[0]
                v = (fy * y / z + cy - px_b[m, 1]) / limits[1]
                squared = u * u + v * v
                if points_b[m, 2] > 0:  # false for NaN
                    w = (1 / z - 1 / points_b[m, 2]) / limits[2]
                    squared += w * w
            if squared < 1:
                inliers[s] += 1
                cost[s] += squared
            else:
                cost[s] += 1
    return cost, inliers


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _normal_equations(
    T_b_a: Array,
    points_a: Array,
    points_b: Array,
    px_b: Array,
    camera: Array,
    variances: Array,
) -> tuple[Array, Array, Array]:
    H, g, squared = np.zeros((6, 6)), np.zeros(6), np.full(len(points_a), np.inf)
    p, e, S, J = np.empty(3), np.empty(3), np.empty((3, 3)), np.empty((3, 6))
    for m in range(len(points_a)):
        for k in range(3):
            p[k] = T_b_a[k, 3]
            for n in range(3):
                p[k] += T_b_a[k, n] * points_a[m, n]
        if p[2] <= NEAREST_M:
            continue
        size = 3 if points_b[m, 2] > 0 else 2  # false for NaN
        e[0] = camera[0] * p[0] / p[2] + camera[2] - px_b[m, 0]
        e[1] = camera[1] * p[1] / p[2] + camera[3] - px_b[m, 1]
        e[2] = 1 / p[2] - 1 / points_b[m, 2]
        _covariance(S, T_b_a, points_a[m], p, camera, variances)
        _jacobian(J, p, camera)
        _whiten(S, e, J, size)
        squared[m] = 0.0
        for k in range(size):
            squared[m] += e[k] * e[k]
        weight = 1 / (1 + squared[m] / CAUCHY_SIGMAS**2)
        for k in range(size):
            for i in range(6):
                g[i] += weight * J[k, i] * e[k]
                for j in range(6):
                    H[i, j] += weight * J[k, i] * J[k, j]
    return H, g, squared


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _covariance(
    S: Array, T_b_a: Array, point_a: Array, p: Array, camera: Array, variances: Array
) -> None:
    """Covariance (3, 3) of (u, v, 1/z) in b: b's own, and a's carried over by the motion."""
    w = 1 / p[2]
    Z = point_a[2]
    A = np.empty((3, 3))
    for n in range(3):  # columns: a's u, v, 1/z; rows: the point in b, then its pixel
        if n < 2:
            scale = Z / camera[n]
            x, y, z = T_b_a[0, n] * scale, T_b_a[1, n] * scale, T_b_a[2, n] * scale
        else:
            x = -Z * (p[0] - T_b_a[0, 3])
            y = -Z * (p[1] - T_b_a[1, 3])
            z = -Z * (p[2] - T_b_a[2, 3])
        A[0, n] = camera[0] * w * (x - p[0] * w * z)
        A[1, n] = camera[1] * w * (y - p[1] * w * z)
        A[2, n] = -w * w * z
    for i in range(3):
        for j in range(3):
            S[i, j] = variances[i] if i == j else 0.0
            for n in range(3):
                S[i, j] += A[i, n] * variances[n] * A[j, n]


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _jacobian(J: Array, p: Array, camera: Array) -> None:
    """Derivative (3, 6) of (u, v, 1/z) by the tangent at ``T_a_b``, rotation first."""
    w = 1 / p[2]
    for n in range(6):
        # The point moves by p x rotation - translation.
        x = (0.0, -p[2], p[1], -1.0, 0.0, 0.0)[n]
        y = (p[2], 0.0, -p[0], 0.0, -1.0, 0.0)[n]
        z = (-p[1], p[0], 0.0, 0.0, 0.0, -1.0)[n]
        J[0, n] = camera[0] * w * (x - p[0] * w * z)
        J[1, n] = camera[1] * w * (y - p[1] * w * z)
        J[2, n] = -w * w * z


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _whiten(S: Array, e: Array, J: Array, size: int) -> None:
    """Divide e and J by the Cholesky factor of the leading part of S, in place."""
    for k in range(size):
        for n in range(k):
            factor = S[k, n]
            for i in range(n):
                factor -= S[k, i] * S[n, i]
            S[k, n] = factor / S[n, n]
            S[k, k] -= S[k, n] * S[k, n]
        S[k, k] = np.sqrt(S[k, k])
        for n in range(k):
            e[k] -= S[k, n] * e[n]
            for i in range(6):
                J[k, i] -= S[k, n] * J[n, i]
        e[k] /= S[k, k]
        for i in range(6):
            J[k, i] /= S[k, k]
