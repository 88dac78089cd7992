"""Keypoints to 3D points by the pinhole model; compiled, since every frame lifts all its own."""

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.config import RegistrationConfig
from vnav.core.camera import Intrinsics

FILLED = 0.6  # share of the window that must have depth
EDGE_SIGMAS = 4.0  # a pixel farther off the plane lies on another surface
NOISE_WINDOWS = 16  # a row and a column of them tell an image's noise
SMOOTH = 0.25  # share of them that lie on one surface at least


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
    What is farther than ``max_depth_m`` counts as without depth. Claim 3, S4.
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
    sigma = max(config.depth_sigma_per_m2, _noise(depth_m, reach, farthest_m))
    limits = EDGE_SIGMAS * sigma, farthest_m
    planes = _planes(px, depth_m, reach, *limits)
    refused = np.isnan(planes[:, 0])
    planes[refused] = _planes(px[refused], depth_m, config.edge_window_px // 2, *limits)
    return planes


def _noise(depth_m: NDArray[np.float32], reach: int, max_depth_m: float) -> float:
    """Standard deviation of inverse depth, 1/m, about planes in an image's smoothest places."""
    shown = _deviations(depth_m, reach, max_depth_m)
    return float(np.quantile(shown, SMOOTH)) if len(shown) else 0.0


@compiled
def _deviations(
    depth_m: NDArray[np.float32], reach: int, max_depth_m: float
) -> NDArray[np.float64]:
    """Of inverse depth about the plane in each window (N,) of an even grid that has depth."""
    height, width = depth_m.shape
    size = 2 * reach + 1
    window, px = np.zeros((size * size, 3)), np.zeros(2)
    found, count = np.zeros(NOISE_WINDOWS * NOISE_WINDOWS), 0
    for k in range(len(found)):
        px[0] = (k % NOISE_WINDOWS + 0.5) / NOISE_WINDOWS * width
        px[1] = (k // NOISE_WINDOWS + 0.5) / NOISE_WINDOWS * height
        filled = _fill(window, px, depth_m, reach, max_depth_m)
        if filled >= FILLED * size * size:
            found[count] = np.sqrt(_off(window[:filled], _plane(window[:filled]))[1])
            count += 1
    return found[:count]


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
        count = _fill(window, px[n], depth_m, reach, max_depth_m)
        if count < FILLED * size * size or count < 3:
            continue
        plane = _plane(window[:count])
        if plane[0] > 0 and _off(window[:count], plane)[0] <= limit:
            planes[n] = plane
    return planes


@compiled
def _fill(
    window: NDArray[np.float64],
    px: NDArray[np.float64],
    depth_m: NDArray[np.float32],
    reach: int,
    max_depth_m: float,
) -> int:
    """Put the pixels around one that have depth into the window; how many there are."""
    height, width = depth_m.shape
    x, y, count = int(np.rint(px[0])), int(np.rint(px[1])), 0
    for v in range(max(0, y - reach), min(height, y + reach + 1)):
        for u in range(max(0, x - reach), min(width, x + reach + 1)):
            if 0 < depth_m[v, u] <= max_depth_m:
                window[count] = u - px[0], v - px[1], 1.0 / depth_m[v, u]
                count += 1
    return count


@compiled
def _plane(window: NDArray[np.float64]) -> tuple[float, float, float]:
    """Value at the keypoint and slopes of the plane through the window's inverse depths."""
    count, x, y, w = len(window), 0.0, 0.0, 0.0
    xx, xy, yy, xw, yw = 1e-9, 0.0, 1e-9, 0.0, 0.0  # no slope across a single row of pixels
    for k in range(count):
        a, b, value = window[k]
        x, y, w = x + a, y + b, w + value
        xx, xy, yy = xx + a * a, xy + a * b, yy + b * b
        xw, yw = xw + a * value, yw + b * value
    x, y, w = x / count, y / count, w / count
    xx, xy, yy = xx - count * x * x, xy - count * x * y, yy - count * y * y
    xw, yw = xw - count * x * w, yw - count * y * w
    det = xx * yy - xy * xy
    slope_x, slope_y = (xw * yy - yw * xy) / det, (yw * xx - xw * xy) / det
    return w - slope_x * x - slope_y * y, slope_x, slope_y


@compiled
def _off(window: NDArray[np.float64], plane: tuple[float, float, float]) -> tuple[float, float]:
    """How far the inverse depths of a window lie off a plane: the farthest, and the mean square."""
    value, slope_x, slope_y = plane
    farthest, squares = 0.0, 0.0
    for k in range(len(window)):
        x, y, inverse_depth = window[k]
        off = abs(inverse_depth - value - slope_x * x - slope_y * y)
        farthest, squares = max(farthest, off), squares + off * off
    return farthest, squares / len(window)
