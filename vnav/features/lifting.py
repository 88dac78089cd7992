"""Keypoints to 3D points by the pinhole model; compiled, since every frame lifts all its own."""

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.config import RegistrationConfig
from vnav.core.camera import Intrinsics
from vnav.core.depth_planes import FILLED, depth_noise, fill, off_plane, plane_through

EDGE_SIGMAS = 4.0  # a pixel farther off the plane lies on another surface


def lift(
    keypoints_px: NDArray[np.float32],
    depth_m: NDArray[np.float32],
    intrinsics: Intrinsics,
    config: RegistrationConfig,
    max_depth_m: float = np.inf,
) -> NDArray[np.float32]:
    """3D points (N, 3) in the camera of keypoints (N, 2), NaN where depth does not hold.

    A plane is fitted to the inverse depths around the keypoint (exact for a plane in the scene,
    and the noise of a structured-light sensor is even in inverse depth) and read off at its
    sub-pixel place. Refused where less than 60 % of the window has depth, or where a pixel lies
    off the plane by more than the noise explains: a depth edge. There a narrower window is tried.
    The noise is that of the settings, or what the image shows where that is more. What is farther
    than ``max_depth_m`` counts as without depth. Claim 3, S4.
    """
    inverse_depth = inverse_depth_planes(keypoints_px, depth_m, config, max_depth_m)[:, 0]
    return intrinsics.unproject(keypoints_px, 1 / inverse_depth).astype(np.float32)


def inverse_depth_planes(
    keypoints_px: NDArray[np.floating],
    depth_m: NDArray[np.float32],
    config: RegistrationConfig,
    max_depth_m: float = np.inf,
) -> NDArray[np.float64]:
    """Inverse depth (1/m) at keypoints (N, 2), and its slopes in x and y (1/m a pixel): (N, 3).

    Those of the plane that `lift` reads off; NaN where it refuses one.
    """
    px = np.ascontiguousarray(keypoints_px, np.float64)
    depth_m = np.ascontiguousarray(depth_m, np.float32)
    reach, farthest_m = config.depth_window_px // 2, float(np.float32(max_depth_m))
    sigma = max(config.depth_sigma_per_m2, depth_noise(depth_m, reach, farthest_m))
    limits = EDGE_SIGMAS * sigma, farthest_m
    planes = _planes(px, depth_m, reach, *limits)
    refused = np.isnan(planes[:, 0])
    planes[refused] = _planes(px[refused], depth_m, config.edge_window_px // 2, *limits)
    return planes


@compiled
def _planes(
    px: NDArray[np.float64],
    depth_m: NDArray[np.float32],
    reach: int,
    limit: float,
    max_depth_m: float,
) -> NDArray[np.float64]:
    """Inverse depth and its slopes (N, 3) at each pixel, NaN where they do not hold."""
    planes = np.full((len(px), 3), np.nan)
    size = 2 * reach + 1
    window = np.zeros((size * size, 3))  # offsets in x and y, inverse depth
    for n in range(len(px)):
        count = fill(window, px[n], depth_m, reach, max_depth_m)
        if count < FILLED * size * size or count < 3:
            continue
        plane = plane_through(window[:count])
        if plane[0] > 0 and off_plane(window[:count], plane)[0] <= limit:
            planes[n] = plane
    return planes
