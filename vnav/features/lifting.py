"""Keypoints to 3D points by the pinhole model."""

import numpy as np
from numpy.typing import NDArray

from vnav.config import RegistrationConfig
from vnav.core.camera import Intrinsics

Array = NDArray[np.float64]


def lift(
    keypoints_px: NDArray[np.float32],
    depth_m: NDArray[np.float32],
    intrinsics: Intrinsics,
    config: RegistrationConfig,
) -> NDArray[np.float32]:
    """3D points (N, 3) in the camera of keypoints (N, 2), NaN where depth does not hold.

    A plane is fitted to the inverse depths around the keypoint (exact for a plane in the scene,
    and the noise of a structured-light sensor is even in inverse depth) and read off at its
    sub-pixel place. Refused where less than 60 % of the window has depth, or where a pixel lies
    off the plane by more than the noise explains: a depth edge. Claim 3, S4.
    """
    inverse_depth, offsets = _windows(keypoints_px, depth_m, config.depth_window_px)
    valid = inverse_depth > 0
    plane, residual = _fit_planes(inverse_depth, valid, offsets)
    edge = np.abs(residual).max(1, initial=0) > 4 * config.depth_sigma_per_m2
    sparse = valid.sum(1) < 0.6 * valid.shape[1]
    good = ~edge & ~sparse & (plane[:, 0] > 0)
    z = np.where(good, 1 / np.where(good, plane[:, 0], 1.0), np.nan)
    return intrinsics.unproject(keypoints_px, z).astype(np.float32)


def _windows(
    keypoints_px: NDArray[np.float32], depth_m: NDArray[np.float32], size: int
) -> tuple[Array, Array]:
    """Inverse depths (N, S) around the keypoints, 0 where none; offsets (N, S, 2) from them."""
    height, width = depth_m.shape
    steps = np.arange(size) - size // 2
    grid = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
    pixels = np.rint(keypoints_px).astype(np.intp)[:, None, :] + grid
    x, y = pixels[..., 0], pixels[..., 1]
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    z = np.where(inside, depth_m[y.clip(0, height - 1), x.clip(0, width - 1)], 0.0)
    inverse = np.where(z > 0, 1 / np.where(z > 0, z, 1.0), 0.0)
    return inverse, pixels - keypoints_px[:, None, :].astype(float)


def _fit_planes(values: Array, valid: NDArray[np.bool_], offsets: Array) -> tuple[Array, Array]:
    """Planes (N, 3) (value at the keypoint, slopes) and the residuals (N, S), 0 where invalid."""
    design = np.concatenate([np.ones((*values.shape, 1)), offsets], -1) * valid[..., None]
    normal = np.einsum("nsi,nsj->nij", design, design) + 1e-9 * np.eye(3)
    plane = np.linalg.solve(normal, np.einsum("nsi,ns->ni", design, values)[..., None])[..., 0]
    residual = (values - np.einsum("nsi,ni->ns", design, plane)) * valid
    return plane, residual
