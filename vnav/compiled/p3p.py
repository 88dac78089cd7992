"""Poses from three points and known rays; compiled, as RANSAC solves very many.

Source: Persson, Nordberg, "Lambda Twist: an accurate fast robust perspective three point solver",
2018.
"""

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.compiled.triangles import dot, fill_axes

Array = NDArray[np.float64]
Pair = tuple[float, float]
Three = tuple[float, float, float]  # of the pairs of points 12, 13, 23, or of the points
Six = tuple[float, float, float, float, float, float]  # a symmetric matrix: 00 01 02 11 12 22

POLISHING = 2  # Gauss-Newton steps on the depths


@compiled
def p3p(rays: Array, points_world: Array) -> Array:
    """All poses ``T_camera_world`` (H, 3, 4) that send three points onto their rays.

    ``rays`` (S, 3, 3) unit vectors in the camera and ``points_world`` (S, 3, 3), one row a point;
    a set gives up to four poses, a degenerate one none.
    """
    poses, count = np.empty((4 * len(rays), 3, 4)), 0
    camera, camera_axes, world_axes = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for s in range(len(rays)):
        world = points_world[s]
        fill_axes(world, world_axes)
        a, b = _squared_sides(world), _cosines(rays[s])
        for plane in _planes(a, b):
            for d1, d2, d3 in _on_plane(plane, a, b):
                if min(d1, d2, d3) > 0 and max(d1, d2, d3) < np.inf:  # false for NaN
                    _scaled(rays[s], _polished((d1, d2, d3), a, b), camera)
                    fill_axes(camera, camera_axes)
                    _aligned(camera, camera_axes, world, world_axes, poses[count])
                    count += np.isfinite(poses[count].sum())
    return poses[:count]


@compiled
def _squared_sides(p: Array) -> Three:
    """Squared distances of three points (3, 3)."""
    a12 = (p[0, 0] - p[1, 0]) ** 2 + (p[0, 1] - p[1, 1]) ** 2 + (p[0, 2] - p[1, 2]) ** 2
    a13 = (p[0, 0] - p[2, 0]) ** 2 + (p[0, 1] - p[2, 1]) ** 2 + (p[0, 2] - p[2, 2]) ** 2
    a23 = (p[1, 0] - p[2, 0]) ** 2 + (p[1, 1] - p[2, 1]) ** 2 + (p[1, 2] - p[2, 2]) ** 2
    return a12, a13, a23


@compiled
def _cosines(rays: Array) -> Three:
    """Of the angles between three rays (3, 3)."""
    return dot(rays[0], rays[1]), dot(rays[0], rays[2]), dot(rays[1], rays[2])


@compiled
def _planes(a: Three, b: Three) -> tuple[Pair, Pair]:
    """Two planes of depths ``depth_1 = w0 depth_2 + w1 depth_3``, as w0, w1.

    The degenerate member D0 of two quadrics falls into them. Of the quadratic equation for depth_1:
    as D0 is degenerate, its discriminant is the square of ``r2 depth_2 + r3 depth_3``.
    """
    (a12, a13, a23), (b12, b13, b23) = a, b
    D1 = a23, -a23 * b12, 0.0, a23 - a12, a12 * b23, -a12
    D2 = a23, 0.0, -a23 * b13, -a13, a13 * b23, a23 - a13
    g = _degenerate_member(D1, D2)
    d00, d01, d02 = D1[0] + g * D2[0], D1[1] + g * D2[1], D1[2] + g * D2[2]
    d11, d12, d22 = D1[3] + g * D2[3], D1[4] + g * D2[4], D1[5] + g * D2[5]
    r2_squared, r2_r3, r3_squared = d01 * d01 - d00 * d11, d01 * d02 - d00 * d12, d02 * d02
    r3_squared = r3_squared - d00 * d22
    larger = np.sqrt(max(r2_squared, r3_squared, 0.0))
    other = r2_r3 / (larger if larger > 0 else 1.0)
    r2, r3 = (larger, other) if r2_squared > r3_squared else (other, larger)
    return ((r2 - d01) / d00, (r3 - d02) / d00), ((-r2 - d01) / d00, (-r3 - d02) / d00)


@compiled
def _degenerate_member(D1: Six, D2: Six) -> float:
    """A real root g of ``det(D1 + g D2)``."""
    adjugate1, adjugate2 = _adjugate(D1), _adjugate(D2)
    c3, c2 = _trace(adjugate2, D2) / 3, _trace(adjugate2, D1)
    c1, c0 = _trace(adjugate1, D2), _trace(adjugate1, D1) / 3
    return float(_real_root(c2 / c3, c1 / c3, c0 / c3))


@compiled
def _adjugate(D: Six) -> Six:
    """Adjugate of a symmetric matrix: its inverse times its determinant."""
    d00, d01, d02, d11, d12, d22 = D
    a00, a01, a02 = d11 * d22 - d12 * d12, d02 * d12 - d01 * d22, d01 * d12 - d02 * d11
    return a00, a01, a02, d00 * d22 - d02 * d02, d01 * d02 - d00 * d12, d00 * d11 - d01 * d01


@compiled
def _trace(A: Six, B: Six) -> float:
    """Trace of the product of two symmetric matrices."""
    off_diagonal = A[1] * B[1] + A[2] * B[2] + A[4] * B[4]
    return float(A[0] * B[0] + A[3] * B[3] + A[5] * B[5] + 2 * off_diagonal)


@compiled
def _real_root(c2: float, c1: float, c0: float) -> float:
    """One real root of ``x^3 + c2 x^2 + c1 x + c0``, by Cardano, then Newton."""
    p, q = c1 - c2**2 / 3, 2 * c2**3 / 27 - c2 * c1 / 3 + c0
    discriminant = q**2 / 4 + p**3 / 27
    if discriminant > 0:
        root = np.sqrt(discriminant)
        x = np.cbrt(-q / 2 + root) + np.cbrt(-q / 2 - root) - c2 / 3
    else:
        radius = np.sqrt(max(-p / 3, 0.0))
        cosine = min(max(-q / 2 / max(radius**3, 1e-300), -1.0), 1.0)
        x = 2 * radius * np.cos(np.arccos(cosine) / 3) - c2 / 3
    for _ in range(3):
        slope = (3 * x + 2 * c2) * x + c1
        if slope != 0:
            x -= (((x + c2) * x + c1) * x + c0) / slope
    return float(x)


@compiled
def _on_plane(plane: Pair, a: Three, b: Three) -> tuple[Three, Three]:
    """Depths on a plane, from the two ratios tau of third to second depth."""
    (w0, w1), (a12, _, a23), (b12, _, b23) = plane, a, b
    # a23 * (d1^2 - 2 b12 d1 d2 + d2^2) = a12 * (d2^2 - 2 b23 d2 d3 + d3^2), with d2 = 1, d3 = tau
    qa = a23 * w1 * w1 - a12
    qb = 2 * (a23 * (w0 - b12) * w1 + a12 * b23)
    qc = a23 * (w0 * (w0 - 2 * b12) + 1) - a12
    half = -0.5 * (qb + np.copysign(np.sqrt(qb * qb - 4 * qa * qc), qb))
    first, second = half / qa, qc / half
    d2 = np.sqrt(a23 / (first * (first - 2 * b23) + 1))
    e2 = np.sqrt(a23 / (second * (second - 2 * b23) + 1))
    return (
        (w0 * d2 + w1 * first * d2, d2, first * d2),
        (w0 * e2 + w1 * second * e2, e2, second * e2),
    )


@compiled
def _polished(depths: Three, a: Three, b: Three) -> Three:
    """Depths after Gauss-Newton on the three squared distances."""
    (d1, d2, d3), (a12, a13, a23), (b12, b13, b23) = depths, a, b
    for _ in range(POLISHING):
        f12 = (d1 * (d1 - 2 * b12 * d2) + d2 * d2 - a12) / 2
        f13 = (d1 * (d1 - 2 * b13 * d3) + d3 * d3 - a13) / 2
        f23 = (d2 * (d2 - 2 * b23 * d3) + d3 * d3 - a23) / 2
        # J = [[p, q, 0], [r, 0, s], [0, t, u]]
        p, r, t = d1 - b12 * d2, d1 - b13 * d3, d2 - b23 * d3
        q, s, u = d2 - b12 * d1, d3 - b13 * d1, d3 - b23 * d2
        determinant = p * s * t + q * r * u
        d1 += (s * (q * f23 - t * f12) - q * u * f13) / determinant
        d2 += (u * (p * f13 - r * f12) - p * s * f23) / determinant
        d3 += (t * (r * f12 - p * f13) - q * r * f23) / determinant
    return d1, d2, d3


@compiled
def _scaled(rays: Array, depths: Three, points: Array) -> None:
    """Fill the points (3, 3) that lie on the rays at those depths."""
    for k in range(3):
        for n in range(3):
            points[k, n] = depths[k] * rays[k, n]


@compiled
def _aligned(
    camera: Array, camera_axes: Array, world: Array, world_axes: Array, pose: Array
) -> None:
    """Fill the pose (3, 4) that moves a triangle with its axes from the world to the camera."""
    for i in range(3):
        pose[i, 3] = camera[0, i]
        for j in range(3):
            pose[i, j] = 0.0
            for k in range(3):
                pose[i, j] += camera_axes[k, i] * world_axes[k, j]
            pose[i, 3] -= pose[i, j] * world[0, j]
