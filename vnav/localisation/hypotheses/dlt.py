"""Camera matrices from six or more points: the direct linear transform, many sets at once.

Source: Hartley, Zisserman, "Multiple View Geometry", 2nd ed., 4.4.4 and 7.1; claim 4, 2.10.
"""

import numpy as np

from vnav.core.arrays import Array


def dlt(image: Array, points_world: Array) -> Array:
    """Projection matrices (S, 3, 4) of sets of P >= 6 points, seen in front of the camera.

    ``image`` (S, P, 2) pixels or normalised coordinates, ``points_world`` (S, P, 3). The scale is
    such that the third row gives depth. NaN where the points do not determine the camera, as when
    they lie in one plane.
    """
    T_image, x = _normalised(image)
    T_points, X = _normalised(points_world)
    Xh = np.concatenate([X, np.ones((*X.shape[:2], 1))], -1)
    zero = np.zeros_like(Xh)
    A = np.concatenate(
        [
            np.concatenate([Xh, zero, -x[..., :1] * Xh], -1),
            np.concatenate([zero, Xh, -x[..., 1:] * Xh], -1),
        ],
        1,
    )
    values, vectors = np.linalg.eigh(np.swapaxes(A, 1, 2) @ A)
    P = np.linalg.inv(T_image) @ vectors[:, :, 0].reshape(-1, 3, 4) @ T_points
    P = P / np.linalg.norm(P[:, 2:, :3], axis=2, keepdims=True)
    P = P * np.sign(np.linalg.det(P[:, :, :3]))[:, None, None]
    P[values[:, 1] < 1e-9 * values[:, -1]] = np.nan
    return np.asarray(P)


def poses_of(P: Array) -> Array:
    """``T_camera_world`` (S, 3, 4) nearest to matrices of cameras with K = I.

    The left 3x3 part is projected onto the rotations, the translation follows its scale.
    """
    valid = np.asarray(np.isfinite(P).all((1, 2)))
    U, scale, Vt = np.linalg.svd(np.where(valid[:, None, None], P, np.eye(3, 4))[:, :, :3])
    pose = np.concatenate([U @ Vt, P[:, :, 3:] / scale.mean(1)[:, None, None]], -1)
    pose[~valid | (np.linalg.det(pose[:, :, :3]) < 0)] = np.nan
    return pose


def focal_of(P: Array) -> Array:
    """Focal lengths in pixels (S,) of camera matrices, from K by RQ decomposition.

    The geometric mean of fx and fy; principal point and skew are what the points make of them.
    """
    M = P[:, :, :3]
    # K R (K R)^T = K K^T, upper triangular from below: the Cholesky factor read backwards.
    S = M @ np.swapaxes(M, 1, 2)
    with np.errstate(invalid="ignore"):
        cx, cy = S[:, 0, 2] / S[:, 2, 2], S[:, 1, 2] / S[:, 2, 2]
        fy_squared = S[:, 1, 1] / S[:, 2, 2] - cy**2
        skew = (S[:, 0, 1] / S[:, 2, 2] - cx * cy) ** 2 / fy_squared
        fx_squared = S[:, 0, 0] / S[:, 2, 2] - cx**2 - skew
        return np.asarray(np.sqrt(np.sqrt(fx_squared * fy_squared)))


def _normalised(points: Array) -> tuple[Array, Array]:
    """A similarity (S, D+1, D+1) that centres points and scales them to sqrt(D); its result."""
    d = points.shape[-1]
    centre = points.mean(1, keepdims=True)
    size = np.sqrt(((points - centre) ** 2).sum(-1).mean(1))[:, None, None]
    scale = np.sqrt(d) / np.maximum(size, 1e-12)
    T = np.zeros((len(points), d + 1, d + 1))
    T[:, :d, :d] = scale * np.eye(d)
    T[:, :d, d:] = -scale * np.swapaxes(centre, 1, 2)
    T[:, d, d] = 1
    return T, scale * (points - centre)
