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
        poses = _poses(depths[..., None] * rays[of_set], points_world[of_set])
    return poses[np.isfinite(poses).all((1, 2))]


def _depths(rays: Array, points: Array) -> tuple[Array, NDArray[np.intp]]:
    """Distances (H, 3) of the points along their rays, and which set each belongs to."""
    pairs = ([0, 0, 1], [1, 2, 2])  # 12, 13, 23
    a = ((points[:, pairs[0]] - points[:, pairs[1]]) ** 2).sum(-1)
    b = (rays[:, pairs[0]] * rays[:, pairs[1]]).sum(-1)
    M12, M13, M23 = (_quadric(*pair, b[:, k]) for k, pair in enumerate(zip(*pairs, strict=True)))
    a12, a13, a23 = (a[:, k, None, None] for k in range(3))
    D1, D2 = M12 * a23 - M23 * a12, M13 * a23 - M23 * a13
    D0 = D1 + _degenerate_member(D1, D2)[:, None, None] * D2
    found = [_on_line(w, a, b) for w in _lines(D0)]
    depths = np.concatenate([d for pair in found for d in pair])
    of_set = np.tile(np.arange(len(rays)), 4)
    usable = np.isfinite(depths).all(1) & (depths > 0).all(1)
    depths, of_set = depths[usable], of_set[usable]
    return _polished(depths, a[of_set], b[of_set]), of_set


def _quadric(i: int, j: int, cosine: Array) -> Array:
    """The matrices (S, 3, 3) of ``depth_i^2 - 2 cosine depth_i depth_j + depth_j^2``."""
    M = np.zeros((len(cosine), 3, 3))
    M[:, i, i] = M[:, j, j] = 1
    M[:, i, j] = M[:, j, i] = -cosine
    return M


def _degenerate_member(D1: Array, D2: Array) -> Array:
    """A real root g (S,) of ``det(D1 + g D2)``."""
    adjugate1, adjugate2 = _adjugate(D1), _adjugate(D2)
    c3 = np.linalg.det(D2)
    c2 = np.einsum("sij,sji->s", adjugate2, D1) / c3
    c1 = np.einsum("sij,sji->s", adjugate1, D2) / c3
    c0 = np.linalg.det(D1) / c3
    return _real_root(c2, c1, c0)


def _adjugate(D: Array) -> Array:
    """Adjugates (S, 3, 3) of matrices: their inverse times their determinant."""
    return _cross(D[:, [1, 2, 0]], D[:, [2, 0, 1]]).swapaxes(1, 2)


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
    """The two planes ``depth_1 = w0 depth_2 + w1 depth_3`` (S, 2) that D0 falls into."""
    finite = np.asarray(np.isfinite(D0).all((1, 2)))
    values, vectors = np.linalg.eigh(np.where(finite[:, None, None], D0, np.eye(3)))
    # The middle eigenvalue is the one that vanishes: the two others have opposite signs.
    s = np.sqrt(np.maximum(-values[:, 0] / values[:, 2], 0))[:, None]
    e_low, e_high = vectors[:, :, 0], vectors[:, :, 2]
    planes = []
    for normal in (e_high - s * e_low, e_high + s * e_low):
        w = -normal[:, 1:] / normal[:, :1]
        planes.append(np.where(finite[:, None], w, np.nan))
    return planes[0], planes[1]


def _on_line(w: Array, a: Array, b: Array) -> tuple[Array, Array]:
    """Depths (S, 3), twice, on one plane, from ratio tau of third to second depth."""
    (w0, w1), (a12, _, a23), (b12, _, b23) = w.T, a.T, b.T
    # a23 * (d1^2 - 2 b12 d1 d2 + d2^2) = a12 * (d2^2 - 2 b23 d2 d3 + d3^2), with d2 = 1, d3 = tau
    qa = a23 * w1**2 - a12
    qb = a23 * 2 * (w0 * w1 - b12 * w1) + 2 * a12 * b23
    qc = a23 * (w0**2 - 2 * b12 * w0 + 1) - a12
    root = np.sqrt(qb**2 - 4 * qa * qc)
    half = -0.5 * (qb + np.where(qb < 0, -1, 1) * root)
    depths = []
    for tau in (half / qa, qc / half):
        d2 = np.sqrt(a23 / (tau * (tau - 2 * b23) + 1))
        d3 = tau * d2
        depths.append(np.stack([w0 * d2 + w1 * d3, d2, d3], -1))
    return depths[0], depths[1]


def _polished(depths: Array, a: Array, b: Array) -> Array:
    """Depths after Gauss-Newton on the three squared distances."""
    i, j = [0, 0, 1], [1, 2, 2]
    for _ in range(POLISHING):
        di, dj = depths[:, i], depths[:, j]
        residual = di**2 - 2 * b * di * dj + dj**2 - a
        J = np.zeros((len(depths), 3, 3))
        rows = np.arange(3)
        J[:, rows, i], J[:, rows, j] = 2 * (di - b * dj), 2 * (dj - b * di)
        step = np.einsum("sij,sj->si", _adjugate(J), residual)
        depths = depths - step / np.linalg.det(J)[:, None]
    return depths


def _poses(points_camera: Array, points_world: Array) -> Array:
    """``T_camera_world`` (H, 3, 4) from three points (H, 3, 3) known on both sides."""
    R = _basis(points_camera) @ np.swapaxes(_basis(points_world), 1, 2)
    t = points_camera[:, 0] - np.einsum("hij,hj->hi", R, points_world[:, 0])
    return np.concatenate([R, t[..., None]], -1)


def _cross(a: Array, b: Array) -> Array:
    """Cross products (..., 3); several times faster than numpy's."""
    return a[..., [1, 2, 0]] * b[..., [2, 0, 1]] - a[..., [2, 0, 1]] * b[..., [1, 2, 0]]


def _basis(points: Array) -> Array:
    """Orthonormal axes, as columns, of the triangles (H, 3, 3)."""
    x = points[:, 1] - points[:, 0]
    x = x / np.linalg.norm(x, axis=1, keepdims=True)
    z = _cross(x, points[:, 2] - points[:, 0])
    z = z / np.linalg.norm(z, axis=1, keepdims=True)
    return np.stack([x, _cross(z, x), z], -1)
