"""Which corners become features of the filter, and which stay: [000 sections 1 and 3.1]."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.config import Config
from vnav.core.arrays import Array, Rows
from vnav.core.camera import Intrinsics
from vnav.features.lifting import inverse_depth_planes
from vnav.features.segment_test import corners
from vnav.tracking.ekf.templates import REACH_PX, Template

MIN_DISTANCE_PX = 12.0  # of a new feature from those there are: their templates hardly overlap
MIN_PREDICTIONS = 10  # from when on a feature must be matched in half of them
SPREAD = 0.5  # of an inverse depth that only a nearest distance is known of, as a share of itself


@dataclass
class TrackedFeature:
    """A feature's first image, and how often it was predicted in the image and matched."""

    number: int
    template: Template
    predicted: int = 0
    matched: int = 0

    @property
    def is_poor(self) -> bool:
        """Whether it was matched in less than half of ten predictions or more."""
        return self.predicted >= MIN_PREDICTIONS and 2 * self.matched < self.predicted

    @property
    def is_good(self) -> bool:
        """Whether it was matched in half of ten predictions or more."""
        return self.predicted >= MIN_PREDICTIONS and not self.is_poor


@dataclass(frozen=True)
class Corners:
    """New features: pixels (N, 2), inverse depths of their z (N,) in 1/m, and their sigmas (N,).

    ``slopes`` (N, 2) of the surface's inverse depth, 1/m a pixel, 0 where it is not known.
    """

    px: Array
    inverse_depth: Array
    sigma: Array
    slopes: Array

    def __len__(self) -> int:
        return len(self.px)

    def __getitem__(self, rows: Rows) -> "Corners":
        return Corners(self.px[rows], self.inverse_depth[rows], self.sigma[rows], self.slopes[rows])


def new_corners(
    gray: NDArray[np.uint8],
    depth_m: NDArray[np.float32],
    seen_px: Array,
    count: int,
    camera: Intrinsics,
    config: Config,
) -> Corners:
    """At most ``count`` corners, the strongest of each cell of the image that has no feature yet.

    ``seen_px`` (M, 2): where features are. Cells are squares, as many as there may be features.
    """
    ekf, fast = config.tracking.ekf, config.features.fast
    px, strength = corners(gray, ekf.corner_threshold, fast.arc, fast.edge_limit)
    fits = _is_free(px, seen_px, camera)
    px, strength = px[fits], strength[fits]
    found = (_with_depth if ekf.depth else _without)(px.astype(float), depth_m, config)
    known = np.flatnonzero(np.isfinite(found.inverse_depth))
    strongest_first = known[np.argsort(-strength[known], kind="stable")]
    edge_px = math.sqrt(camera.width * camera.height / ekf.max_features)
    return found[_one_per_cell(found.px, strongest_first, seen_px, edge_px)[:count]]


def _one_per_cell(px: Array, rows: Rows, seen_px: Array, edge_px: float) -> Rows:
    """The first of some rows of pixels (N, 2) in each cell where nothing is seen yet."""
    taken = {tuple(cell) for cell in (seen_px // edge_px).tolist()}
    first: dict[tuple[float, ...], int] = {}
    for row, cell in zip(rows.tolist(), (px[rows] // edge_px).tolist(), strict=True):
        if tuple(cell) not in taken:
            first.setdefault(tuple(cell), row)
    return np.array(list(first.values()), np.intp)


def _is_free(px: NDArray[np.float32], seen_px: Array, camera: Intrinsics) -> NDArray[np.bool_]:
    """Which corners (N,) have a whole patch in the image, and no feature beside them."""
    free = ((px >= REACH_PX) & (px < np.array(camera.size) - REACH_PX)).all(1)
    for seen in seen_px:
        free &= ((px - seen) ** 2).sum(1) > MIN_DISTANCE_PX**2
    return np.asarray(free)


def _with_depth(px: Array, depth_m: NDArray[np.float32], config: Config) -> Corners:
    """As depth measures them; NaN where it does not, or on a depth edge."""
    farthest_m = config.odometry.max_depth_m
    planes = inverse_depth_planes(px, depth_m, config.registration, farthest_m)
    sigma = np.full(len(px), config.registration.depth_sigma_per_m2)
    return Corners(px, planes[:, 0], sigma, planes[:, 1:])


def _without(px: Array, _: NDArray[np.float32], config: Config) -> Corners:
    """Anywhere from a nearest distance to infinity."""
    inverse = np.full(len(px), 1 / (2 * config.tracking.ekf.nearest_m))
    return Corners(px, inverse, SPREAD * inverse, np.zeros((len(px), 2)))
