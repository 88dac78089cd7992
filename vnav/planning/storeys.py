"""Storeys: a grid is of one floor, and cameras may have been carried over others."""

import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array

LOWEST_M, HIGHEST_M = -0.3, 2.4  # of a camera above the floor that it is carried over
FEWEST = 10  # frames that make a storey of their own
AROUND_M = 2.0  # of a camera: how far its floor is looked for
WITHIN_M = 0.25  # of where the usual height of cameras has that floor
BAND_M = 0.02  # of heights that are counted together


def is_over_floor(height_m: float) -> bool:
    """Whether a camera so high above a floor is carried over it, and not over another."""
    return LOWEST_M < height_m < HIGHEST_M


def other_floor(cameras: Array, points_world: NDArray[np.floating], floor_m: float) -> float | None:
    """The height of another floor that cameras (F, 3) were carried over; None where there is none.

    Cameras are held as high above it as above the floor at ``floor_m``, about. It is the height at
    which most points (N, 3) lie near these cameras. That over which more frames were taken, where
    there are floors above and below.
    """
    cameras = cameras[np.isfinite(cameras).all(1)]
    heights_m = cameras[:, 2] - floor_m
    above, below = heights_m >= HIGHEST_M, heights_m <= LOWEST_M
    over, elsewhere = ~(above | below), max(above, below, key=np.count_nonzero)
    if not over.any() or elsewhere.sum() < FEWEST:
        return None
    climbed_m = np.median(heights_m[elsewhere]) - np.median(heights_m[over])
    expected_m = floor_m + float(climbed_m)
    near_m = _heights_near(points_world, cameras[elsewhere], expected_m)
    return _commonest(near_m) if len(near_m) else expected_m


def _heights_near(
    points_world: NDArray[np.floating], cameras: Array, expected_m: float
) -> NDArray[np.floating]:
    """Heights of the points about the one that is expected, beside any of the cameras."""
    from scipy.spatial import cKDTree

    points = points_world[np.abs(points_world[:, 2] - expected_m) < WITHIN_M]
    away_m, _ = cKDTree(cameras[:, :2]).query(points[:, :2], distance_upper_bound=AROUND_M)
    return np.asarray(points[np.isfinite(away_m), 2])


def _commonest(heights_m: NDArray[np.floating]) -> float:
    """The mean of the band with most heights (N,), N at least 1."""
    band = np.floor(heights_m / BAND_M)
    values, counts = np.unique(band, return_counts=True)
    return float(heights_m[np.abs(band - values[counts.argmax()]) <= 1].mean())
