"""Matching near a predicted place; compiled, since only few pairs are near each other."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.compiled.descriptors import squared_distance
from vnav.core.frame import Features


def match_guided(
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
    rows: NDArray[np.int32] = _match_guided(
        np.ascontiguousarray(predicted_px, np.float64),
        a.space.comparable(a.descriptors),
        b.keypoints_px,
        b.space.comparable(b.descriptors),
        np.array([radius_px, a.space.squared(ratio), a.space.squared(max_distance)]),
    )
    return rows


@compiled
def _match_guided(
    predicted: NDArray[np.float64],
    descriptors_a: NDArray[Any],
    px_b: NDArray[np.float32],
    descriptors_b: NDArray[Any],
    limits: NDArray[np.float64],
) -> NDArray[np.int32]:
    radius, ratio_squared, most = limits
    order = np.argsort(px_b[:, 1], kind="mergesort")
    px = px_b[order].astype(np.float64)
    described = descriptors_b[order]
    heights = px[:, 1].copy()
    taken_by = np.full(len(px), -1, np.int32)  # of rivals for one feature of b, the nearest
    taken_at = np.full(len(px), np.inf)
    for i in range(len(predicted)):
        x, y = predicted[i]
        if not (x == x and y == y):
            continue
        nearest, first, second = _two_nearest(
            descriptors_a[i], described, px, heights, (x, y, radius)
        )
        if first < ratio_squared * second and first < most and first < taken_at[nearest]:
            taken_by[nearest], taken_at[nearest] = i, first
    matched = np.full(len(predicted), -1, np.int32)
    for k in range(len(px)):
        if taken_by[k] >= 0:
            matched[taken_by[k]] = order[k]
    rows = np.flatnonzero(matched >= 0)
    return np.stack((rows.astype(np.int32), matched[rows]), 1)


@compiled
def _two_nearest(
    descriptor: NDArray[Any],
    described: NDArray[Any],
    px: NDArray[np.float64],
    heights: NDArray[np.float64],
    circle: tuple[float, float, float],
) -> tuple[int, float, float]:
    """The row in a circle that is nearest by descriptor, or -1, and the two least distances."""
    x, y, radius = circle
    nearest, first, second = -1, np.inf, np.inf
    for k in range(np.searchsorted(heights, y - radius), len(px)):
        if heights[k] > y + radius:
            break
        dx, dy = px[k, 0] - x, heights[k] - y
        if dx * dx + dy * dy > radius * radius:
            continue
        squared = float(squared_distance(descriptor, described[k]))
        if squared < first:
            nearest, first, second = k, squared, first
        elif squared < second:
            second = squared
    return nearest, first, second
