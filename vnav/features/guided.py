"""Matching near a predicted place; compiled, since only few pairs are near each other."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vnav.core.frame import Features


def match_near(
    a: Features,
    b: Features,
    predicted_px: NDArray[np.float64],
    radius_px: float,
    ratio: float,
    max_distance: float,
) -> NDArray[np.int32]:
    """Rows (M, 2) of a's and b's features that are each other's nearest within reach.

    ``predicted_px`` (A, 2): where in b's image a's features should be, NaN for those that have no
    place there. Kept where nearest / second-nearest distance in reach is below ``ratio``; where
    only one feature is in reach there is no ratio, and its distance must be below
    ``max_distance``, as that of any match must.
    """
    order = np.argsort(b.keypoints_px[:, 1], kind="stable")
    px_b = np.ascontiguousarray(b.keypoints_px[order], np.float64)
    nearest, squared = _nearest_near(
        np.ascontiguousarray(predicted_px, np.float64),
        np.ascontiguousarray(a.descriptors),
        px_b,
        np.ascontiguousarray(b.descriptors[order]),
        radius_px,
    )
    limit = max_distance**2
    good = (squared[:, 0] < ratio**2 * squared[:, 1]) & (squared[:, 0] < limit)
    rows = np.flatnonzero(good)
    rows = rows[np.argsort(squared[rows, 0], kind="stable")]
    _, first = np.unique(nearest[rows], return_index=True)  # of rivals for one feature, the nearest
    rows = np.sort(rows[first])
    return np.stack([rows, order[nearest[rows]]], 1).astype(np.int32)


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _nearest_near(
    predicted: NDArray[np.float64],
    descriptors_a: NDArray[np.uint8],
    px_b: NDArray[np.float64],
    descriptors_b: NDArray[np.uint8],
    radius: float,
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Row of the nearest of b in reach, -1 if none, and squared distances of the two nearest."""
    count, size = descriptors_a.shape
    nearest = np.full(count, -1, np.int64)
    squared = np.full((count, 2), np.inf)
    for i in range(count):
        x, y = predicted[i]
        if not (x == x and y == y):
            continue
        k = np.searchsorted(px_b[:, 1], y - radius)
        while k < len(px_b) and px_b[k, 1] <= y + radius:
            dx, dy = px_b[k, 0] - x, px_b[k, 1] - y
            if dx * dx + dy * dy <= radius * radius:
                total = np.int32(0)
                for d in range(size):
                    difference = np.int32(descriptors_a[i, d]) - np.int32(descriptors_b[k, d])
                    total += difference * difference
                if total < squared[i, 0]:
                    squared[i, 1] = squared[i, 0]
                    squared[i, 0] = float(total)
                    nearest[i] = k
                elif total < squared[i, 1]:
                    squared[i, 1] = float(total)
            k += 1
    return nearest, squared
