"""Non-linear refinement of the motion between two frames; compiled: claim 3, S5."""

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Array
from vnav.registration.compiled_geometry import MIN_Z_M, Point, exp, inverse, jacobian, transform

CAUCHY_SIGMAS = 2.0
MEDIAN_CHI_SQUARED = 2.366  # with 3 degrees of freedom
LEAST_VARIANCE = 0.04  # of residuals, of that assumed: matches of rendered images have as little
ITERATIONS = 12
CONVERGED = 1e-5  # rad and m: a tenth of what the best pair of frames can tell


@compiled
def gauss_newton(
    T_a_b: Array,
    source: Array,
    target: Array,
    forward: NDArray[np.bool_],
    cameras: Array,
    variances: Array,
    depth_variances: Array,
    converged: float,
) -> tuple[Array, Array, Array]:
    """The refined ``T_a_b``, with the normal matrix (6, 6) and squared residuals (M,) there.

    What counts less is told by the residuals' own variance, where that is less than assumed: few
    matches of what moves close by would else bend the motion by less than the noise assumed
    (an M-estimator with its scale: Huber 1981, "Robust Statistics", chapter 7).

    ``source`` (M, 3): points in the camera a (forward) or b; ``target`` (M, 3): pixel and inverse
    depth, NaN where there is none, in the other; ``cameras`` (2, 4): fx, fy, cx, cy of a and of b;
    ``variances`` (3,) of pixel and inverse depth, ``depth_variances`` (M,) of the source's;
    ``converged``: a step, rad and m, that is the last.
    """
    T, variance = T_a_b.copy(), 1.0
    for _ in range(ITERATIONS):
        H, g, squared = normal_equations(
            T, source, target, forward, cameras, variances, depth_variances, variance
        )
        variance = _variance(squared)
        step = -np.linalg.solve(H + 1e-9 * (1 + np.trace(H)) * np.eye(6), g)
        T = T @ exp(step)
        if np.abs(step).max() < converged:
            break
    H, g, squared = normal_equations(
        T, source, target, forward, cameras, variances, depth_variances, variance
    )
    return T, H, squared


@compiled
def normal_equations(
    T_a_b: Array,
    source: Array,
    target: Array,
    forward: NDArray[np.bool_],
    cameras: Array,
    variances: Array,
    depth_variances: Array,
    variance: float,
) -> tuple[Array, Array, Array]:
    """Normal matrix (6, 6), gradient (6,) and squared residuals (M,) of a motion.

    ``variance``: of residuals, of that assumed; it says which count less.
    """
    H, g, squared = np.zeros((6, 6)), np.zeros(6), np.full(len(source), np.inf)
    e, S, J = np.empty(3), np.empty((3, 3)), np.empty((3, 6))
    T_b_a = inverse(T_a_b)
    for m in range(len(source)):
        T, here, there = (T_b_a, cameras[0], cameras[1])
        if not forward[m]:
            T, here, there = (T_a_b, cameras[1], cameras[0])
        p = transform(T, source[m])
        if p[2] <= MIN_Z_M:
            continue
        size = 3 if target[m, 2] > 0 else 2  # false for NaN
        e[0] = there[0] * p[0] / p[2] + there[2] - target[m, 0]
        e[1] = there[1] * p[1] / p[2] + there[3] - target[m, 1]
        e[2] = 1 / p[2] - target[m, 2]
        carried_covariance(S, T, source[m], p, here, there, variances, depth_variances[m])
        if forward[m]:
            jacobian(J, T_a_b, p, p, there, True)
        else:
            jacobian(J, T_a_b, source[m], p, there, False)
        whiten(S, e, J, size)
        squared[m] = 0.0
        for k in range(size):
            squared[m] += e[k] * e[k]
        weight = 1 / (1 + squared[m] / (variance * CAUCHY_SIGMAS**2))
        add_rows(H, g, J, e, weight, size)
    mirror(H)
    return H, g, squared


@compiled
def _variance(squared: Array) -> float:
    """Of residuals, of that assumed, by the median of their squares; 1 at most."""
    finite = squared[squared < np.inf]
    if not len(finite):
        return 1.0
    return min(1.0, max(LEAST_VARIANCE, np.median(finite) / MEDIAN_CHI_SQUARED))


@compiled
def add_rows(H: Array, g: Array, J: Array, e: Array, weight: float, size: int) -> None:
    """Add a residual's rows to the gradient, and to the upper triangle of the normal matrix."""
    for k in range(size):
        for i in range(6):
            weighted = weight * J[k, i]
            g[i] += weighted * e[k]
            for j in range(i, 6):
                H[i, j] += weighted * J[k, j]


@compiled
def mirror(H: Array) -> None:
    """Write a symmetric matrix (6, 6) below its diagonal as above it."""
    for i in range(6):
        for j in range(i):
            H[i, j] = H[j, i]


@compiled
def carried_covariance(
    S: Array,
    T: Array,
    point: Array,
    p: Point,
    here: Array,
    there: Array,
    variances: Array,
    depth_variance: float,
) -> None:
    """Covariance (3, 3) of (u, v, 1/z) there: its own, and that of the point carried over by T.

    Only its lower triangle is written. ``depth_variance``: of the point's own inverse depth.
    """
    w = 1 / p[2]
    Z = point[2]
    for i in range(3):
        for j in range(3):
            S[i, j] = variances[i] if i == j else 0.0
    for n in range(3):  # u, v, 1/z here: what they do to the point there, then to its pixel
        variance = variances[n] if n < 2 else depth_variance
        if n < 2:
            scale = Z / here[n]
            x, y, z = T[0, n] * scale, T[1, n] * scale, T[2, n] * scale
        else:
            x = -Z * (p[0] - T[0, 3])
            y = -Z * (p[1] - T[1, 3])
            z = -Z * (p[2] - T[2, 3])
        a = (there[0] * w * (x - p[0] * w * z), there[1] * w * (y - p[1] * w * z), -w * w * z)
        for i in range(3):
            for j in range(i + 1):
                S[i, j] += a[i] * variance * a[j]


@compiled
def whiten(S: Array, e: Array, J: Array, size: int) -> None:
    """Divide e and J by the Cholesky factor of the leading part of S, in place.

    Only the lower triangle of S is asked.
    """
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
