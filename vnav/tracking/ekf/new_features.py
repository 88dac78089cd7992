"""Features that join the state where the camera sees them first: [000 section 3.1].

Source: Civera, Davison, Montiel, "Inverse depth parametrization for monocular SLAM", 2008, III.
"""

import numpy as np

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.tracking.ekf.quaternions import derivative_of_rotated
from vnav.tracking.ekf.state import FEATURE, POSE, POSITION, ROTATION, FilterState


def with_features(
    state: FilterState,
    px: Array,
    inverse_depth: Array,
    sigma: Array,
    camera: Intrinsics,
    sigma_px: float,
) -> FilterState:
    """The state with features at pixels (N, 2) of the current image.

    ``inverse_depth`` (N,) of their z, 1/m, and its ``sigma`` (N,). What is not known of the camera
    is not known of them either.
    """
    y, by_pose, by_pixel, by_inverse = new_features(state.x, px, inverse_depth, camera)
    n, size = len(px), len(state.x)
    by_pose = by_pose.reshape(n * FEATURE, 7)
    cross = by_pose @ state.P[POSE]  # (6 N, M)
    P = np.zeros((size + n * FEATURE,) * 2)
    P[:size, :size] = state.P
    P[size:, :size], P[:size, size:] = cross, cross.T
    P[size:, size:] = cross[:, POSE] @ by_pose.T
    own = sigma_px**2 * by_pixel @ np.swapaxes(by_pixel, 1, 2)
    own += sigma[:, None, None] ** 2 * by_inverse @ np.swapaxes(by_inverse, 1, 2)
    for k in range(n):
        block = slice(size + FEATURE * k, size + FEATURE * (k + 1))
        P[block, block] += own[k]
    return FilterState(np.append(state.x, y), P)


def new_features(
    x: Array, px: Array, inverse_depth: Array, camera: Intrinsics
) -> tuple[Array, Array, Array, Array]:
    """Features (N, 6) and their derivatives by pose (N, 6, 7), pixel (N, 6, 2), inverse depth."""
    n, q = len(px), x[ROTATION]
    rays = camera.unproject(px, np.ones(n))
    lengths = np.linalg.norm(rays, axis=1)
    R = se3.rotation_from_quat(q)
    turned = rays @ R.T
    a, b, c = turned.T
    flat = np.hypot(a, c)
    y = np.column_stack(
        [np.tile(x[POSITION], (n, 1)), np.arctan2(a, c), np.arctan2(-b, flat)]
        + [inverse_depth / lengths]
    )
    zero = np.zeros(n)
    azimuth = np.stack([c / flat**2, zero, -a / flat**2], -1)
    elevation = np.stack([a * b / flat, -flat, b * c / flat], -1) / lengths[:, None] ** 2
    by_ray = np.stack([azimuth, elevation], 1)  # (N, 2, 3)
    by_pose, by_pixel = np.zeros((n, FEATURE, 7)), np.zeros((n, FEATURE, 2))
    by_pose[:, :3, :3] = np.eye(3)
    by_pose[:, 3:5, 3:] = by_ray @ derivative_of_rotated(q, rays)
    per_pixel = np.array([1 / camera.fx, 1 / camera.fy])
    by_pixel[:, 3:5] = by_ray @ (R[:, :2] * per_pixel)
    by_pixel[:, 5] = -(inverse_depth / lengths**3)[:, None] * rays[:, :2] * per_pixel
    by_inverse = np.zeros((n, FEATURE, 1))
    by_inverse[:, 5, 0] = 1 / lengths
    return y, by_pose, by_pixel, by_inverse
