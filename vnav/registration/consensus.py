"""The motion that most matches agree with, by RANSAC on three matches each: claim 3, S5.

Compiled as a whole: every frame tries many, and what runs compiled leaves the interpreter to the
threads that find features.
"""

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.compiled.triangles import dot, fill_axes
from vnav.core.arrays import Array
from vnav.registration.compiled_geometry import MIN_Z_M, inverse

Projection = tuple[float, ...]  # of 15

MIN_TRIALS = 16  # however many agree with the first: three noisy points make a rough motion


@compiled
def best_motion(
    samples: NDArray[np.intp],
    points_a: Array,
    points_b: Array,
    px_b: Array,
    camera: Array,
    limits: Array,
    confidence: float,
) -> Array:
    """``T_a_b`` (4, 4) of lowest cost among those of the samples (S, 3)."""
    best, best_cost, needed = np.eye(4), np.inf, float(len(samples))
    for trial in range(len(samples)):
        if trial >= max(needed, MIN_TRIALS):
            break
        rows = samples[trial]
        T_b_a = _aligned(points_b[rows], points_a[rows])
        cost, inliers = _cost(T_b_a, points_a, points_b, px_b, camera, limits, best_cost)
        if cost < best_cost:
            best, best_cost = T_b_a, cost
            share = max(inliers / len(points_a), 1e-3)
            needed = np.log(1 - confidence) / np.log(1 - share**3 + 1e-12)
    T_a_b: Array = inverse(best)
    return T_a_b


@compiled
def sharpest_motion(
    samples: NDArray[np.intp],
    points_a: Array,
    points_b: Array,
    px_b: Array,
    camera: Array,
    sigmas: Array,
    asked: int,
) -> Array:
    """``T_a_b`` (4, 4) of that sample (S, 3) which so many matches agree with most closely.

    Least quantile of squares: Rousseeuw 1984, "Least median of squares regression".
    """
    best, least = np.eye(4), np.inf
    squared = np.empty(len(points_a))
    for trial in range(len(samples)):
        rows = samples[trial]
        T_b_a = _aligned(points_b[rows], points_a[rows])
        to_b = _projection(T_b_a, camera, sigmas)
        for m in range(len(points_a)):
            squared[m] = _squared(m, to_b, points_a, points_b, px_b)
        quantile = np.partition(squared, asked)[asked]
        if quantile < least:
            best, least = T_b_a, quantile
    T_a_b: Array = inverse(best)
    return T_a_b


@compiled
def _aligned(points_a: Array, points_b: Array) -> Array:
    """``T_a_b`` between three matched points (3, 3); see `vnav.core.se3.align`.

    The normals of both triangles are made one, then they are turned about it. Points on a line are
    not turned: they have no axes.
    """
    A, B = np.empty((3, 3)), np.empty((3, 3))
    fill_axes(points_a, A)
    fill_axes(points_b, B)
    mean_a, mean_b = np.zeros(3), np.zeros(3)
    for k in range(3):
        mean_a += points_a[k] / 3
        mean_b += points_b[k] / 3
    along, across = 0.0, 0.0
    for k in range(3):
        a, b = points_a[k] - mean_a, points_b[k] - mean_b
        xa, ya = dot(A[0], a), dot(A[1], a)
        xb, yb = dot(B[0], b), dot(B[1], b)
        along, across = along + xa * xb + ya * yb, across + xb * ya - yb * xa
    length = np.hypot(along, across)
    T = np.eye(4)
    if length > 0:  # false for NaN
        c, s = along / length, across / length
        for i in range(3):
            x, y = c * A[0, i] + s * A[1, i], c * A[1, i] - s * A[0, i]
            for j in range(3):
                T[i, j] = x * B[0, j] + y * B[1, j] + A[2, i] * B[2, j]
    for i in range(3):
        T[i, 3] = mean_a[i] - dot(T[i], mean_b)
    return T


@compiled
def _cost(
    T: Array,
    points_a: Array,
    points_b: Array,
    px_b: Array,
    camera: Array,
    limits: Array,
    max_cost: float,
) -> tuple[float, int]:
    """Truncated squared residuals summed, and inliers; left off where it exceeds ``max_cost``."""
    to_b = _projection(T, camera, limits)
    cost, inliers = 0.0, 0
    for m in range(len(points_a)):
        squared = _squared(m, to_b, points_a, points_b, px_b)
        inliers += squared < 1
        cost += min(squared, 1.0)
        if cost > max_cost:
            break
    return cost, inliers


@compiled
def _projection(T: Array, camera: Array, limits: Array) -> Projection:
    """Rows that take a's points to pixels of b over their limits, times z; z's row; 1 / limits."""
    fx, fy, cx, cy = camera
    a, b, c = 1 / limits[0], 1 / limits[1], 1 / limits[2]
    z_row = T[2, 0], T[2, 1], T[2, 2], T[2, 3]
    u_row = (
        a * (fx * T[0, 0] + cx * T[2, 0]),
        a * (fx * T[0, 1] + cx * T[2, 1]),
        a * (fx * T[0, 2] + cx * T[2, 2]),
        a * (fx * T[0, 3] + cx * T[2, 3]),
    )
    v_row = (
        b * (fy * T[1, 0] + cy * T[2, 0]),
        b * (fy * T[1, 1] + cy * T[2, 1]),
        b * (fy * T[1, 2] + cy * T[2, 2]),
        b * (fy * T[1, 3] + cy * T[2, 3]),
    )
    return u_row + v_row + z_row + (a, b, c)


@compiled
def _squared(m: int, to_b: Projection, points_a: Array, points_b: Array, px_b: Array) -> float:
    """Squared residual of a match, of pixel and of inverse depth in b, each by its limit.

    Whatever is read in this loop is a number: an array in its place would be read again each time.
    """
    p, X, Y, Z = to_b, points_a[m, 0], points_a[m, 1], points_a[m, 2]
    z = p[8] * X + p[9] * Y + p[10] * Z + p[11]
    if not z > MIN_Z_M:
        return np.inf
    u = (p[0] * X + p[1] * Y + p[2] * Z + p[3]) / z - px_b[m, 0] * p[12]
    v = (p[4] * X + p[5] * Y + p[6] * Z + p[7]) / z - px_b[m, 1] * p[13]
    squared = u * u + v * v
    measured = points_b[m, 2]
    if measured > 0:  # false for NaN
        w = (1 / z - 1 / measured) * p[14]
        squared += w * w
    return float(squared)
