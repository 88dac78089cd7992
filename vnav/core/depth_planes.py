"""Planes through inverse depth: exact for planes in the scene; compiled, for every frame has many.

The noise of a structured-light sensor is even in inverse depth. Source: Khoshelham and Elberink
2012, "Accuracy and resolution of Kinect depth data".
"""

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled

FILLED = 0.6  # share of a window that must have depth
WINDOWS = 16  # a row and a column of them tell an image's noise
SMOOTH = 0.25  # share of them that lie on one surface at least


def depth_noise(depth_m: NDArray[np.float32], reach: int, max_depth_m: float = np.inf) -> float:
    """Standard deviation of inverse depth, 1/m, that an image (H, W) shows where it is smooth.

    About the planes through windows that reach so many pixels to either side. What is farther than
    ``max_depth_m`` counts as without depth; 0 where there is none.
    """
    shown = _deviations(np.ascontiguousarray(depth_m, np.float32), reach, max_depth_m)
    return float(np.quantile(shown, SMOOTH)) if len(shown) else 0.0


@compiled
def _deviations(
    depth_m: NDArray[np.float32], reach: int, max_depth_m: float
) -> NDArray[np.float64]:
    """Of inverse depth about the plane in each window (N,) of an even grid that has depth."""
    height, width = depth_m.shape
    size = 2 * reach + 1
    window, px = np.zeros((size * size, 3)), np.zeros(2)
    found, count = np.zeros(WINDOWS * WINDOWS), 0
    for k in range(len(found)):
        px[0] = (k % WINDOWS + 0.5) / WINDOWS * width
        px[1] = (k // WINDOWS + 0.5) / WINDOWS * height
        filled = fill(window, px, depth_m, reach, max_depth_m)
        if filled >= FILLED * size * size:
            found[count] = np.sqrt(off_plane(window[:filled], plane_through(window[:filled]))[1])
            count += 1
    return found[:count]


@compiled
def fill(
    window: NDArray[np.float64],
    px: NDArray[np.float64],
    depth_m: NDArray[np.float32],
    reach: int,
    max_depth_m: float,
) -> int:
    """How many pixels around one have depth: in the window's first rows, as x, y, inverse depth."""
    height, width = depth_m.shape
    x, y, count = int(np.rint(px[0])), int(np.rint(px[1])), 0
    for v in range(max(0, y - reach), min(height, y + reach + 1)):
        for u in range(max(0, x - reach), min(width, x + reach + 1)):
            if 0 < depth_m[v, u] <= max_depth_m:
                window[count] = u - px[0], v - px[1], 1.0 / depth_m[v, u]
                count += 1
    return count


@compiled
def plane_through(window: NDArray[np.float64]) -> tuple[float, float, float]:
    """Value at the pixel, and slopes, of the plane through the inverse depths of a window."""
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
def off_plane(
    window: NDArray[np.float64], plane: tuple[float, float, float]
) -> tuple[float, float]:
    """How far the inverse depths of a window lie off a plane: the farthest, and the mean square."""
    value, slope_x, slope_y = plane
    farthest, squares = 0.0, 0.0
    for k in range(len(window)):
        x, y, inverse_depth = window[k]
        off = abs(inverse_depth - value - slope_x * x - slope_y * y)
        farthest, squares = max(farthest, off), squares + off * off
    return farthest, squares / len(window)
