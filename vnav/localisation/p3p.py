"""Poses from three points and known rays, many sets at once.

Source: Persson, Nordberg, "Lambda Twist: an accurate fast robust perspective three point solver",
2018.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

POLISHING = 2  # Gauss-Newton steps on the depths


def p3p(rays: Array, points_world: Array) -> Array:
    """All poses ``T_camera_world`` (H, 3, 4) that send three points onto their rays.

    ``rays`` (S, 3, 3) unit vectors in the camera and ``points_world`` (S, 3, 3), one row a point;
    a set gives up to four poses, a degenerate one none.
    """
    with np.errstate(all="ignore"):
        depths, of_set = _depths(rays, points_world)
        poses = _poses(depths[..., None] * rays[of_set], points_world, of_set)
    return poses[np.isfinite(poses).all((1, 2))]


def _depths(rays: Array, points: Array) -> tuple[Array, NDArray[np.intp]]:
    """Distances (H, 3) of the points along their rays, and which set each belongs to."""
    pairs = ([0, 0, 1], [1, 2, 2])  # 12, 13, 23
    a = np.ascontiguousarray(((points[:, pairs[0]] - points[:, pairs[1]]) ** 2).sum(-1).T)
    b = np.ascontiguousarray((rays[:, pairs[0]] * rays[:, pairs[1]]).sum(-1).T)
    (a12, a13, a23), (b12, b13, b23), zero = a, b, np.zeros(len(rays))
    D1 = np.array([a23, -a23 * b12, zero, a23 - a12, a12 * b23, -a12])
    D2 = np.array([a23, zero, -a23 * b13, -a13, a13 * b23, a23 - a13])
    depths = _on_lines(_lines(D1 + _degenerate_member(D1, D2) * D2), a, b)
    usable = np.isfinite(depths).all(0) & (depths > 0).all(0)
    of_set = np.tile(np.arange(len(rays)), 4)[usable]
    return _polished(depths[:, usable], a[:, of_set], b[:, of_set]).T, of_set


def _degenerate_member(D1: Array, D2: Array) -> Array:
    """A real root g (S,) of ``det(D1 + g D2)``, of symmetric matrices (6, S): 00 01 02 11 12 22."""
    adjugate1, adjugate2 = _adjugate(D1), _adjugate(D2)
    c3, c2 = _trace(adjugate2, D2) / 3, _trace(adjugate2, D1)
    c1, c0 = _trace(adjugate1, D2), _trace(adjugate1, D1) / 3
    return _real_root(c2 / c3, c1 / c3, c0 / c3)


def _adjugate(D: Array) -> Array:
    """Adjugates (6, S) of symmetric matrices: their inverse times their determinant."""
    d00, d01, d02, d11, d12, d22 = D
    first = d11 * d22 - d12 * d12, d02 * d12 - d01 * d22, d01 * d12 - d02 * d11
    return np.array([*first, d00 * d22 - d02 * d02, d01 * d02 - d00 * d12, d00 * d11 - d01 * d01])


def _trace(A: Array, B: Array) -> Array:
    """Traces (S,) of products of symmetric matrices (6, S)."""
    return np.asarray(np.array([1.0, 2, 2, 1, 2, 1]) @ (A * B))


def _real_root(c2: Array, c1: Array, c0: Array) -> Array:
    """One real root (S,) of ``x^3 + c2 x^2 + c1 x + c0``, by Cardano, then Newton."""
    p, q = c1 - c2**2 / 3, 2 * c2**3 / 27 - c2 * c1 / 3 + c0
    discriminant = q**2 / 4 + p**3 / 27
    root = np.sqrt(np.maximum(discriminant, 0))
    single = np.cbrt(-q / 2 + root) + np.cbrt(-q / 2 - root)
    radius = np.sqrt(np.maximum(-p / 3, 0))
    cosine = np.clip(-q / 2 / np.maximum(radius**3, 1e-300), -1, 1)
    x = np.where(discriminant > 0, single, 2 * radius * np.cos(np.arccos(cosine) / 3)) - c2 / 3
    for _ in range(3):
        slope = (3 * x + 2 * c2) * x + c1
        x = x - np.where(slope == 0, 0, (((x + c2) * x + c1) * x + c0) / slope)
    return np.asarray(x)


def _lines(D0: Array) -> tuple[Array, Array]:
    """The two planes ``depth_1 = w0 depth_2 + w1 depth_3`` that D0 falls into: w0, w1 (2, S).

    Of the quadratic equation for depth_1: as D0 is degenerate, its discriminant is the square of
    ``r2 depth_2 + r3 depth_3``.
    """
    d00, d01, d02, d11, d12, d22 = D0
    r2_squared, r2_r3, r3_squared = d01 * d01 - d00 * d11, d01 * d02 - d00 * d12, d02 * d02
    r3_squared = r3_squared - d00 * d22
    larger = np.sqrt(np.maximum(np.maximum(r2_squared, r3_squared), 0))
    other = r2_r3 / np.where(larger > 0, larger, 1)
    second = r2_squared > r3_squared
    r2, r3 = np.where(second, larger, other), np.where(second, other, larger)
    sign = np.array([[1.0], [-1.0]])
    return (sign * r2 - d01) / d00, (sign * r3 - d02) / d00


def _on_lines(w: tuple[Array, Array], a: Array, b: Array) -> Array:
    """Depths (3, 4 S) on either plane, from the two ratios tau of third to second depth."""
    (w0, w1), (a12, _, a23), (b12, _, b23) = w, a, b
    # a23 * (d1^2 - 2 b12 d1 d2 + d2^2) = a12 * (d2^2 - 2 b23 d2 d3 + d3^2), with d2 = 1, d3 = tau
    qa = a23 * w1 * w1 - a12
    qb = 2 * (a23 * (w0 - b12) * w1 + a12 * b23)
    qc = a23 * (w0 * (w0 - 2 * b12) + 1) - a12
    half = -0.5 * (qb + np.copysign(np.sqrt(qb * qb - 4 * qa * qc), qb))
    tau = np.stack([half / qa, qc / half])
    d2 = np.sqrt(a23 / (tau * (tau - 2 * b23) + 1))
    d3 = tau * d2
    return np.stack([w0 * d2 + w1 * d3, d2, d3]).reshape(3, -1)


def _polished(depths: Array, a: Array, b: Array) -> Array:
    """Depths (3, H) after Gauss-Newton on the three squared distances; a, b (3, H)."""
    first, second = [0, 0, 1], [1, 2, 2]
    for _ in range(POLISHING):
        di, dj = depths[first], depths[second]
        f12, f13, f23 = (di * (di - 2 * b * dj) + dj * dj - a) / 2
        # J = [[p, q, 0], [r, 0, s], [0, t, u]]
        (p, r, t), (q, s, u) = di - b * dj, dj - b * di
        x1 = s * (q * f23 - t * f12) - q * u * f13
        x2 = u * (p * f13 - r * f12) - p * s * f23
        x3 = t * (r * f12 - p * f13) - q * r * f23
        depths = depths + np.stack([x1, x2, x3]) / (p * s * t + q * r * u)
    return depths


def _poses(points_camera: Array, points_world: Array, of_set: NDArray[np.intp]) -> Array:
    """``T_camera_world`` (H, 3, 4) from three points (H, 3, 3) in the camera, of a set each."""
    R = _basis(points_camera) @ np.swapaxes(_basis(points_world), 1, 2)[of_set]
    t = points_camera[:, 0] - np.einsum("hij,hj->hi", R, points_world[of_set, 0])
    return np.concatenate([R, t[..., None]], -1)


def _cross(a: Array, b: Array) -> Array:
    """Cross products (..., 3); several times faster than numpy's."""
    return a[..., [1, 2, 0]] * b[..., [2, 0, 1]] - a[..., [2, 0, 1]] * b[..., [1, 2, 0]]


def _basis(points: Array) -> Array:
    """Orthonormal axes, as columns, of the triangles (S, 3, 3)."""
    x = points[:, 1] - points[:, 0]
    z = _cross(x, points[:, 2] - points[:, 0])
    x, z = (v / np.sqrt(np.einsum("si,si->s", v, v))[:, None] for v in (x, z))
    return np.stack([x, _cross(z, x), z], -1)
