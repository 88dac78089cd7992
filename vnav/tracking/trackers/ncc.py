"""Points found by zero-mean normalised cross-correlation of templates: 000 section 2, eq 4."""

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.config import Config
from vnav.core.arrays import Array, Floats
from vnav.core.frame import Features
from vnav.tracking.correlation import (
    MIN_CORRELATION,
    REACH_PX,
    TEMPLATE_PX,
    correlation,
    normalised,
    peak,
)
from vnav.tracking.trackers.grey import grey_of

MAX_BACK_PX = 1.5  # between a point and the best place of what was found, sought back
FINE_PX = 3  # searched around what the image of half the size shows


class NccTracker:
    """Looks for the template around each point, all over the circle that it may be in.

    A template neither turns nor grows: neighbouring images only.
    """

    def __init__(self, color: NDArray[np.uint8], features: Features, config: Config) -> None:
        self._images, self._px = _two_sizes(color), features.keypoints_px.astype(np.float64)
        self._radius_px = config.registration.search_radius_px

    def find(self, color: NDArray[np.uint8], predicted_px: Array) -> Floats:
        """See `Tracker`; places are each other's best."""
        images, found = _two_sizes(color), np.full((len(self._px), 2), np.nan, np.float32)
        rows = np.flatnonzero(np.isfinite(predicted_px).all(1))
        px = self._px[rows]
        there, correlation = self._best(self._images, images, px, predicted_px[rows])
        back, _ = self._best(images, self._images, there, px)
        good = correlation > MIN_CORRELATION  # false for NaN
        good &= np.linalg.norm(back - px, axis=1) < MAX_BACK_PX
        found[rows[good]] = there[good]
        return found

    def _best(
        self, a: tuple[Floats, Floats], b: tuple[Floats, Floats], px: Array, start_px: Array
    ) -> tuple[Array, Array]:
        """Where b's template is most like a's (N, 2), and how much (N,): coarse, then fine."""
        coarse, _ = best_places(a[1], b[1], px / 2, start_px / 2, self._radius_px / 2)
        places, correlation = best_places(a[0], b[0], px, 2 * coarse, FINE_PX)
        return places, correlation


def _two_sizes(color: NDArray[np.uint8]) -> tuple[Floats, Floats]:
    """Brightness, and that of the image of half the size."""
    grey = grey_of(color)
    return grey.astype(np.float32), cv2.pyrDown(grey).astype(np.float32)


@compiled
def best_places(
    image_a: Floats, image_b: Floats, px_a: Array, start_px: Array, radius_px: float
) -> tuple[Array, Array]:
    """Where in b, within a radius of the start, a's templates correlate best (N, 2), and how (N,).

    To a fraction of a pixel. NaN where a template or its place is not in the image, or flat.
    """
    places, best = np.full((len(px_a), 2), np.nan), np.full(len(px_a), np.nan)
    template, reach = np.empty((TEMPLATE_PX, TEMPLATE_PX), np.float32), int(radius_px)
    for n in range(len(px_a)):
        if np.isnan(px_a[n, 0] + start_px[n, 0]):
            continue
        x, y = int(np.rint(px_a[n, 0])), int(np.rint(px_a[n, 1]))
        u, v = int(np.rint(start_px[n, 0])), int(np.rint(start_px[n, 1]))
        if not _take(template, image_a, x, y):
            continue
        top, at_u, at_v = -1.0, u, v
        for dv in range(-reach, reach + 1):
            for du in range(-reach, reach + 1):
                if du * du + dv * dv <= radius_px * radius_px:
                    value = correlation(image_b, template, u + du, v + dv)
                    if value > top:
                        top, at_u, at_v = value, u + du, v + dv
        if top > 0:
            best[n] = top
            beside_u, beside_v = peak(image_b, template, at_u, at_v, top)
            places[n, 0] = px_a[n, 0] - x + at_u + beside_u
            places[n, 1] = px_a[n, 1] - y + at_v + beside_v
    return places, best


@compiled
def _take(template: Floats, image: Floats, x: int, y: int) -> bool:
    """Fill the template about a pixel, normalised; False where it is cut off or flat."""
    height, width = image.shape
    if not (REACH_PX <= x < width - REACH_PX and REACH_PX <= y < height - REACH_PX):
        return False
    template[:] = image[y - REACH_PX : y + REACH_PX + 1, x - REACH_PX : x + REACH_PX + 1]
    return normalised(template)
