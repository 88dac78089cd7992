"""Products of quaternions x, y, z, w and the derivatives that an extended Kalman filter takes."""

import numpy as np

from vnav.core import se3
from vnav.core.arrays import Array

CONJUGATE = np.array([-1.0, -1.0, -1.0, 1.0])


def left_matrix(q: Array) -> Array:
    """The matrix (4, 4) with ``left_matrix(q) @ p`` the product q p."""
    M = q[3] * np.eye(4)
    M[:3, :3] += se3.hat(q[:3])
    M[:3, 3], M[3, :3] = q[:3], -q[:3]
    return np.asarray(M)


def right_matrix(p: Array) -> Array:
    """The matrix (4, 4) with ``right_matrix(p) @ q`` the product q p."""
    M = p[3] * np.eye(4)
    M[:3, :3] -= se3.hat(p[:3])
    M[:3, 3], M[3, :3] = p[:3], -p[:3]
    return np.asarray(M)


def from_rotation_vector(w: Array) -> tuple[Array, Array]:
    """The unit quaternion (4,) of a rotation vector (3,) in radians, and its derivative (4, 3)."""
    half = np.linalg.norm(w) / 2
    a = 0.5 * np.sinc(half / np.pi)  # sin(angle / 2) / angle
    b = (np.cos(half) / 2 - a) / (4 * half**2) if half > 1e-6 else -1 / 24
    derivative = np.vstack([a * np.eye(3) + b * np.outer(w, w), -a * w / 2])
    return np.append(a * w, np.cos(half)), derivative


def normalised(q: Array) -> tuple[Array, Array]:
    """The unit quaternion (4,) along q, and its derivative (4, 4) by q."""
    length = np.linalg.norm(q)
    q = q / length
    return q, (np.eye(4) - np.outer(q, q)) / length


def derivative_of_rotated(q: Array, v: Array) -> Array:
    """Derivatives (N, 3, 4) of vectors (N, 3) turned by q / |q|, by q."""
    q, by_q = normalised(q)
    u, w = q[:3], q[3]
    crossed = np.cross(u, v)
    by_u = -2 * (w * se3.hat(v) + se3.hat(crossed) + se3.hat(u) @ se3.hat(v))
    return np.asarray(np.concatenate([by_u, 2 * crossed[:, :, None]], 2) @ by_q)


def derivative_of_turned_back(q: Array, v: Array) -> Array:
    """Derivatives (N, 3, 4) of vectors (N, 3) turned by the inverse of q / |q|, by q."""
    return np.asarray(derivative_of_rotated(q * CONJUGATE, v) * CONJUGATE)
