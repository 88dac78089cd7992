"""Templates sought by normalised cross-correlation near where they are predicted: [000 eq 4]."""

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Array

TEMPLATE_PX = 11
SEARCH_SIGMAS = 3.0
MAX_SEARCH_PX = 40.0
MIN_CORRELATION = 0.8


@compiled
def search(image: NDArray[np.uint8], templates: Array, predicted_px: Array, S: Array) -> Array:
    """Where an image (H, W) shows templates (N, 11, 11): pixels (N, 2), NaN where it does not.

    Each is sought in the ellipse of 3 standard deviations around its predicted pixel (N, 2), whose
    covariance is S (N, 2, 2), at most 40 px away. The best place must correlate by more than 0.8;
    a parabola through it and its neighbours gives a fraction of a pixel. Without contrast, or where
    a template is NaN, there is no match.
    """
    found = np.full((len(templates), 2), np.nan)
    for n in range(len(templates)):
        template = templates[n] - templates[n].mean()
        norm = np.sqrt((template * template).sum())
        if not (norm > 0 and np.isfinite(predicted_px[n]).all()):
            continue
        template /= norm
        best = _best_place(image, template, predicted_px[n], np.linalg.inv(S[n]), S[n])
        if best[0] > MIN_CORRELATION:
            u, v = int(best[1]), int(best[2])
            found[n, 0] = u + _peak(
                correlation(image, template, u - 1, v),
                best[0],
                correlation(image, template, u + 1, v),
            )
            found[n, 1] = v + _peak(
                correlation(image, template, u, v - 1),
                best[0],
                correlation(image, template, u, v + 1),
            )
    return found


@compiled
def _best_place(
    image: NDArray[np.uint8], template: Array, centre: Array, inverse: Array, S: Array
) -> tuple[float, int, int]:
    """The largest correlation in the ellipse, and its pixel."""
    reach_u = min(SEARCH_SIGMAS * np.sqrt(S[0, 0]), MAX_SEARCH_PX)
    reach_v = min(SEARCH_SIGMAS * np.sqrt(S[1, 1]), MAX_SEARCH_PX)
    best, best_u, best_v = -1.0, 0, 0
    for v in range(int(np.ceil(centre[1] - reach_v)), int(np.floor(centre[1] + reach_v)) + 1):
        for u in range(int(np.ceil(centre[0] - reach_u)), int(np.floor(centre[0] + reach_u)) + 1):
            x, y = u - centre[0], v - centre[1]
            far = inverse[0, 0] * x * x + 2 * inverse[0, 1] * x * y + inverse[1, 1] * y * y
            if far > SEARCH_SIGMAS**2 or x * x + y * y > MAX_SEARCH_PX**2:
                continue
            value = correlation(image, template, u, v)
            if value > best:
                best, best_u, best_v = value, u, v
    return best, best_u, best_v


@compiled
def correlation(image: NDArray[np.uint8], template: Array, u: int, v: int) -> float:
    """Of a template (11, 11) of mean 0 and norm 1 with the image around a pixel; -1 at its edge."""
    half = TEMPLATE_PX // 2
    height, width = image.shape
    if not (half <= u < width - half and half <= v < height - half):
        return -1.0
    total, squares, product = 0.0, 0.0, 0.0
    for i in range(TEMPLATE_PX):
        for j in range(TEMPLATE_PX):
            value = float(image[v + i - half, u + j - half])
            total += value
            squares += value * value
            product += template[i, j] * value
    variance = squares - total * total / TEMPLATE_PX**2
    return product / np.sqrt(variance) if variance > 1e-3 else -1.0


@compiled
def _peak(before: float, here: float, after: float) -> float:
    """Where between -0.5 and 0.5 the parabola through three values is largest."""
    bend = before - 2 * here + after
    if before < -0.99 or after < -0.99 or not bend < 0:
        return 0.0
    return min(0.5, max(-0.5, 0.5 * (before - after) / bend))
