"""Templates sought by normalised cross-correlation near where they are predicted: [000 eq 4]."""

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Array
from vnav.tracking.correlation import MIN_CORRELATION, correlation, normalised, peak

SEARCH_SIGMAS = 3.0
MAX_SEARCH_PX = 40.0


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
        template = templates[n].copy()
        if not (normalised(template) and np.isfinite(predicted_px[n]).all()):
            continue
        best = _best_place(image, template, predicted_px[n], np.linalg.inv(S[n]), S[n])
        if best[0] > MIN_CORRELATION:
            beside_u, beside_v = peak(image, template, best[1], best[2], best[0])
            found[n, 0], found[n, 1] = best[1] + beside_u, best[2] + beside_v
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
