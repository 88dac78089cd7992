"""Rigid transforms: 4x4 matrices ``T_a_b`` that map coordinates in b into a.

Tangent vectors are ``(rotation, translation)``, the order that gtsam uses, and perturb on the
right: ``T @ exp(xi)``. Every function takes one transform or a stack of them in leading axes.
"""

from math import sqrt

import numpy as np
from numpy.typing import ArrayLike

from vnav.core.arrays import Array


def make(R: ArrayLike, t: ArrayLike) -> Array:
    """Transform (..., 4, 4) from rotation R (..., 3, 3) and translation t (..., 3)."""
    R, t = np.asarray(R, float), np.asarray(t, float)
    T = np.zeros((*np.broadcast_shapes(R.shape[:-2], t.shape[:-1]), 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = R, t, 1.0
    return T


def inverse(T: ArrayLike) -> Array:
    """Inverse (..., 4, 4) in closed form."""
    T = np.asarray(T, float)
    Rt, result = T[..., :3, :3].swapaxes(-1, -2), np.zeros(T.shape)
    result[..., :3, :3], result[..., :3, 3:], result[..., 3, 3] = Rt, -(Rt @ T[..., :3, 3:]), 1.0
    return result


def transform(T_a_b: ArrayLike, points_b: ArrayLike) -> Array:
    """Points (..., N, 3) in a from points (N, 3) or (..., N, 3) in b."""
    T_a_b = np.asarray(T_a_b, float)
    rotated = np.asarray(points_b, float) @ np.swapaxes(T_a_b[..., :3, :3], -1, -2)
    return np.asarray(rotated + T_a_b[..., None, :3, 3])


def adjoint(T: ArrayLike) -> Array:
    """Matrices (..., 6, 6) that map tangents on the right of T (..., 4, 4) to those on its left."""
    T = np.asarray(T, float)
    R = T[..., :3, :3]
    return np.block([[R, np.zeros(R.shape)], [hat(T[..., :3, 3]) @ R, R]])


def hat(v: ArrayLike) -> Array:
    """Skew-symmetric matrices (..., 3, 3) with ``hat(v) @ w == cross(v, w)``."""
    v = np.asarray(v, float)
    M = np.zeros((*v.shape, 3))
    M[..., 0, 1], M[..., 0, 2], M[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    M[..., 1, 0], M[..., 2, 0], M[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return M


def exp_so3(w: ArrayLike) -> Array:
    """Rotation (..., 3, 3) from a rotation vector (..., 3) in radians (Rodrigues)."""
    w = np.asarray(w, float)
    angle = np.linalg.norm(w, axis=-1)[..., None, None]
    W = hat(w)
    small = angle < 1e-8
    safe = np.where(small, 1.0, angle)
    a = np.where(small, 1.0 - angle**2 / 6, np.sin(safe) / safe)
    b = np.where(small, 0.5 - angle**2 / 24, (1 - np.cos(safe)) / safe**2)
    return np.asarray(np.eye(3) + a * W + b * (W @ W))


def log_so3(R: ArrayLike) -> Array:
    """Rotation vector (..., 3) of R (..., 3, 3), angle in [0, pi], by way of the quaternion."""
    q = quat_xyzw(R)
    q = np.where(q[..., 3:] < 0, -q, q)
    sine = np.linalg.norm(q[..., :3], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(sine, q[..., 3:])
    return np.asarray(q[..., :3] * np.where(sine < 1e-12, 2.0, angle / np.maximum(sine, 1e-12)))


def exp(xi: ArrayLike) -> Array:
    """Transform (..., 4, 4) from a tangent vector (..., 6), rotation first."""
    xi = np.asarray(xi, float)
    w, v = xi[..., :3], xi[..., 3:]
    angle = np.linalg.norm(w, axis=-1)[..., None, None]
    W = hat(w)
    W2 = W @ W
    small = angle < 1e-6
    safe = np.where(small, 1.0, angle)
    a = np.where(small, 1.0 - angle**2 / 6, np.sin(safe) / safe)
    b = np.where(small, 0.5 - angle**2 / 24, (1 - np.cos(safe)) / safe**2)
    c = np.where(small, 1 / 6 - angle**2 / 120, (safe - np.sin(safe)) / safe**3)
    V = np.eye(3) + b * W + c * W2
    return make(np.eye(3) + a * W + b * W2, (V @ v[..., None])[..., 0])


def deviation(T: ArrayLike) -> Array:
    """How far (..., 6) transforms are from none: the rotation vector, then the translation."""
    T = np.asarray(T, float)
    return np.concatenate([log_so3(T[..., :3, :3]), T[..., :3, 3]], -1)


def angle_and_distance(T: ArrayLike) -> Array:
    """How far (..., 2) transforms turn, in radians, and how far they move."""
    parts = deviation(T)
    return np.asarray(np.linalg.norm(parts.reshape(*parts.shape[:-1], 2, 3), axis=-1))


def quat_xyzw(R: ArrayLike) -> Array:
    """Unit quaternion (..., 4) x, y, z, w of a rotation (..., 3, 3) or transform (Shepperd)."""
    R = np.asarray(R, float)[..., :3, :3]
    found = [_quaternion(row) for row in R.reshape(-1, 9).tolist()]
    return np.array(found).reshape(*R.shape[:-2], 4)


def _quaternion(R: list[float]) -> list[float]:
    """Of the nine numbers of one rotation: most are asked for one by one, where arrays are slow."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = R
    trace = xx + yy + zz
    squares = 1 + 2 * xx - trace, 1 + 2 * yy - trace, 1 + 2 * zz - trace, 1 + trace
    largest = squares.index(max(squares))
    x, y, z, w = (
        (squares[0], xy + yx, xz + zx, zy - yz),
        (xy + yx, squares[1], yz + zy, xz - zx),
        (xz + zx, yz + zy, squares[2], yx - xy),
        (zy - yz, xz - zx, yx - xy, squares[3]),
    )[largest]
    length = sqrt(x * x + y * y + z * z + w * w)
    return [x / length, y / length, z / length, w / length]


def rotation_from_quat(q_xyzw: ArrayLike) -> Array:
    """Rotation (..., 3, 3) from a quaternion (..., 4) x, y, z, w of any non-zero length."""
    q = np.asarray(q_xyzw, float)
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    V = hat(q[..., :3])
    return np.asarray(np.eye(3) + 2 * q[..., 3, None, None] * V + 2 * V @ V)


def orthonormal(T: ArrayLike) -> Array:
    """Transforms (..., 4, 4) whose rotations are exact, from such that rounding has spoiled."""
    T = np.asarray(T, float)
    return make(rotation_from_quat(quat_xyzw(T)), T[..., :3, 3])


def rotation_angle(R: ArrayLike) -> Array:
    """Angle in radians (...) of rotations (..., 3, 3) or transforms (..., 4, 4)."""
    return np.asarray(np.linalg.norm(log_so3(np.asarray(R, float)[..., :3, :3]), axis=-1))


def align(points_a: ArrayLike, points_b: ArrayLike) -> Array:
    """Least-squares ``T_a_b`` (..., 4, 4) between matched points (..., N, 3), N >= 3.

    Source: Arun, Huang, Blostein 1987, with Umeyama's 1991 sign; claim 3, S5. Collinear or
    coincident points leave the rotation about their line free; some rotation is returned.
    """
    a, b = np.asarray(points_a, float), np.asarray(points_b, float)
    mean_a, mean_b = a.mean(-2), b.mean(-2)
    H = np.swapaxes(a - mean_a[..., None, :], -1, -2) @ (b - mean_b[..., None, :])
    U, _, Vt = np.linalg.svd(H)
    sign = np.ones((*H.shape[:-2], 3))
    sign[..., 2] = np.sign(np.linalg.det(U) * np.linalg.det(Vt))
    R = U @ (sign[..., None] * Vt)
    return make(R, mean_a - (R @ mean_b[..., None])[..., 0])


def is_rigid(T: ArrayLike, tolerance: float = 1e-6) -> bool:
    """Whether T (..., 4, 4) is finite, its rotation orthonormal and right-handed."""
    T = np.asarray(T, float)
    R = T[..., :3, :3]
    return bool(
        np.isfinite(T).all()
        and np.allclose(R @ np.swapaxes(R, -1, -2), np.eye(3), atol=tolerance)
        and (np.linalg.det(R) > 0).all()
        and np.allclose(T[..., 3, :], [0, 0, 0, 1])
    )
