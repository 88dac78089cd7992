"""A photo's features, in the order of the vocabulary tree and in image buckets."""

import dataclasses
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.core.camera import Intrinsics
from vnav.core.frame import Features
from vnav.core.map_index import ranges, spans_of
from vnav.core.tree import VocabularyTree
from vnav.localisation.refine import Lens
from vnav.localisation.words import Database

Rows = NDArray[np.intp]

SAME_KEYPOINT_PX = 2.0  # a keypoint's second orientation lies nearer than this


@dataclass(frozen=True)
class Photo:
    """Features sorted along the tree, their ``paths`` (N, levels + 1) and each node's rows.

    ``lens``: of the image the features were found in, without distortion.
    """

    features: Features
    paths: NDArray[np.int32]
    span: NDArray[np.int32]
    lens: Lens

    @cached_property
    def database(self) -> Database:
        """The features as what landmarks are searched in."""
        f = self.features
        return Database(f.descriptors, f.keypoints_px, SAME_KEYPOINT_PX)

    @property
    def intrinsics(self) -> Intrinsics:
        """Those of the lens; its focal length may be a guess."""
        return self.lens.intrinsics

    @property
    def pixel(self) -> float:
        """A pixel of an image 640 wide, in pixels of this one: what thresholds are scaled by."""
        return max(self.intrinsics.size) / 640

    def near(self, px: NDArray[np.float64], radius_px: float) -> tuple[Rows, Rows]:
        """Pairs: row of ``px`` (P, 2), in the image, and a feature within the radius of it."""
        buckets = self._buckets(radius_px)
        # Three cells side by side are one run of the sorted features.
        first = buckets.of(px)[:, None] + buckets.columns * np.array([-1, 0, 1])
        source, place = ranges(buckets.start[first.ravel() - 1], buckets.start[first.ravel() + 2])
        source //= 3
        x, y = px.T
        dx = buckets.x.take(place) - x.take(source)
        dy = buckets.y.take(place) - y.take(source)
        close = np.flatnonzero(dx * dx + dy * dy < radius_px**2)
        return source[close], buckets.order[place[close]]

    def _buckets(self, radius_px: float) -> "Buckets":
        """The features in cells of that edge; those of the radii that were asked for are kept."""
        if radius_px not in self._bucketed:
            px, size = self.features.keypoints_px.astype(float), self.intrinsics.size
            self._bucketed[radius_px] = Buckets.filled(px, radius_px, size)
        return self._bucketed[radius_px]

    @cached_property
    def _bucketed(self) -> "dict[float, Buckets]":
        return {}


@dataclass(frozen=True)
class Buckets:
    """Points sorted by the square cell of the image that they lie in; a cell is around it, empty.

    ``order`` (N,): the points' numbers, ``x``, ``y`` (N,) where they are, ``start``: of each cell.
    """

    edge_px: float
    columns: int
    start: Rows
    order: Rows
    x: NDArray[np.float64]
    y: NDArray[np.float64]

    @classmethod
    def filled(cls, px: NDArray[np.float64], edge_px: float, size: tuple[int, int]) -> "Buckets":
        """With points (N, 2) of an image; those outside are put into the nearest cell."""
        columns, rows = (int(extent / edge_px) + 3 for extent in size)
        cell = (np.floor(px / edge_px).astype(np.intp) + 1).clip(1, [columns - 2, rows - 2])
        bucket = cell[:, 1] * columns + cell[:, 0]
        order = np.argsort(bucket, kind="stable")
        start = np.append(0, np.cumsum(np.bincount(bucket, minlength=columns * rows)))
        x, y = np.ascontiguousarray(px[order].T)
        return cls(edge_px, columns, start, order, x, y)

    def of(self, px: NDArray[np.float64]) -> Rows:
        """The cell (P,) of each point (P, 2) in the image."""
        column, row = np.floor(px / self.edge_px).astype(np.intp).T + 1
        return np.asarray(row * self.columns + column)


def prepare(
    features: Features, intrinsics: Intrinsics, focal_sigma: float, tree: VocabularyTree
) -> Photo:
    """Undistort, quantise and sort a photo's features (claim 4, 2.2)."""
    features, intrinsics = _undistorted(features, intrinsics)
    paths = tree.quantise(features.descriptors)
    order = np.lexsort(paths.T[::-1])
    paths = paths[order]
    span = spans_of(paths, len(tree.level))
    return Photo(features[order], paths, span, Lens(intrinsics, focal_sigma))


def _undistorted(features: Features, intrinsics: Intrinsics) -> tuple[Features, Intrinsics]:
    if not any(intrinsics.distortion) or not len(features):
        return features, intrinsics
    K = intrinsics.K
    px = cv2.undistortPoints(
        features.keypoints_px[:, None], K, np.array(intrinsics.distortion), P=K
    )
    straight = dataclasses.replace(intrinsics, distortion=())
    return dataclasses.replace(features, keypoints_px=px[:, 0]), straight
