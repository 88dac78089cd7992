"""Non-linear refinement of the motion between two frames; compiled: claim 3, S5."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
NEAREST_M = 0.05  # nothing is seen nearer than this
CAUCHY_SIGMAS = 2.0
ITERATIONS = 12
CONVERGED = 1e-5  # rad and m: a tenth of what the best pair of frames can tell


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def gauss_newton(
    T_a_b: Array,
    points_a: Array,
    points_b: Array,
    px_b: Array,
    camera: Array,
    variances: Array,
) -> tuple[Array, Array, Array]:
    """The refined ``T_a_b``, with the normal matrix (6, 6) and squared residuals (M,) there."""
    T = T_a_b.copy()
    for _ in range(ITERATIONS):
        H, g, _ = _normal_equations(_inverse(T), points_a, points_b, px_b, camera, variances)
        step = -np.linalg.solve(H + 1e-9 * (1 + np.trace(H)) * np.eye(6), g)
        T = T @ _exp(step)
        if np.abs(step).max() < CONVERGED:
            break
    H, g, squared = _normal_equations(_inverse(T), points_a, points_b, px_b, camera, variances)
    return T, H, squared


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _inverse(T: Array) -> Array:
    result = np.eye(4)
    R = np.ascontiguousarray(T[:3, :3].T)
    result[:3, :3], result[:3, 3] = R, -R @ np.ascontiguousarray(T[:3, 3])
    return result


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _exp(xi: Array) -> Array:
    """See `vnav.core.se3.exp`."""
    x, y, z = xi[:3]
    angle = np.sqrt(x * x + y * y + z * z)
    W = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    a, b, c = 1.0, 0.5, 1 / 6
    if angle > 1e-6:
        a, b = np.sin(angle) / angle, (1 - np.cos(angle)) / angle**2
        c = (angle - np.sin(angle)) / angle**3
    T = np.eye(4)
    T[:3, :3] += a * W + b * (W @ W)
    T[:3, 3] = (np.eye(3) + b * W + c * (W @ W)) @ xi[3:]
    return T


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
