"""Rigid motions and projection as compiled loops call them, one point at a time."""

import numpy as np

from vnav.compiled import compiled
from vnav.core.arrays import Array

Point = tuple[float, float, float]
MIN_Z_M = 0.05  # nothing is seen nearer than this


@compiled
def inverse(T: Array) -> Array:
    """See `vnav.core.se3.inverse`."""
    result = np.eye(4)
    R = np.ascontiguousarray(T[:3, :3].T)
    result[:3, :3], result[:3, 3] = R, -R @ np.ascontiguousarray(T[:3, 3])
    return result


@compiled
def transform(T: Array, point: Array | Point) -> Point:
    """A point moved by T, as three numbers: to make an array of each would take longer."""
    x, y, z = point[0], point[1], point[2]
    return (
        T[0, 3] + T[0, 0] * x + T[0, 1] * y + T[0, 2] * z,
        T[1, 3] + T[1, 0] * x + T[1, 1] * y + T[1, 2] * z,
        T[2, 3] + T[2, 0] * x + T[2, 1] * y + T[2, 2] * z,
    )


@compiled
def exp(xi: Array) -> Array:
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


@compiled
def jacobian(
    J: Array, T_a_b: Array, point_b: Array | Point, p: Point, camera: Array, forward: bool
) -> None:
    """Derivative (3, 6) of (u, v, 1/z) at p by the tangent at ``T_a_b``, rotation first.

    Forward, p is the point in b, and moves against the camera; else it is in a, and moves along.
    """
    w = 1 / p[2]
    X, Y, Z = point_b[0], point_b[1], point_b[2]
    for n in range(6):
        x = (0.0, -Z, Y, -1.0, 0.0, 0.0)[n]  # of the point in b: point x rotation - translation
        y = (Z, 0.0, -X, 0.0, -1.0, 0.0)[n]
        z = (-Y, X, 0.0, 0.0, 0.0, -1.0)[n]
        if not forward:
            R = T_a_b
            x, y, z = (
                -R[0, 0] * x - R[0, 1] * y - R[0, 2] * z,
                -R[1, 0] * x - R[1, 1] * y - R[1, 2] * z,
                -R[2, 0] * x - R[2, 1] * y - R[2, 2] * z,
            )
        J[0, n] = camera[0] * w * (x - p[0] * w * z)
        J[1, n] = camera[1] * w * (y - p[1] * w * z)
        J[2, n] = -w * w * z
