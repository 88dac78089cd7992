"""The motion that most matches agree with, by RANSAC on three matches each: claim 3, S5.

Compiled as a whole: every frame tries many, and what runs compiled leaves the interpreter to the
threads that find features.
"""

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Array
from vnav.registration.compiled_geometry import MIN_Z_M, inverse

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
def _aligned(points_a: Array, points_b: Array) -> Array:
    """``T_a_b`` between three matched points; see `vnav.core.se3.align`."""
    mean_a, mean_b = np.zeros(3), np.zeros(3)
    for k in range(3):
        mean_a += points_a[k] / 3
        mean_b += points_b[k] / 3
    U, _, Vt = np.linalg.svd((points_a - mean_a).T @ (points_b - mean_b))
    if np.linalg.det(U) * np.linalg.det(Vt) < 0:
        U[:, 2] *= -1
    R = U @ Vt
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, mean_a - R @ mean_b
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
    cost, inliers = 0.0, 0
    fx, fy, cx, cy = camera
    for m in range(len(points_a)):
        X, Y, Z = points_a[m]
        z = T[2, 0] * X + T[2, 1] * Y + T[2, 2] * Z + T[2, 3]
        squared = 1.0
        if z > MIN_Z_M:
            x = T[0, 0] * X + T[0, 1] * Y + T[0, 2] * Z + T[0, 3]
            y = T[1, 0] * X + T[1, 1] * Y + T[1, 2] * Z + T[1, 3]
            u = (fx * x / z + cx - px_b[m, 0]) / limits[0]
            v = (fy * y / z + cy - px_b[m, 1]) / limits[1]
            squared = u * u + v * v
            if points_b[m, 2] > 0:  # false for NaN
                w = (1 / z - 1 / points_b[m, 2]) / limits[2]
                squared += w * w
        inliers += squared < 1
        cost += min(squared, 1.0)
        if cost > max_cost:
            break
    return cost, inliers
