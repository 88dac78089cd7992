"""A photo's features, in the order of the vocabulary tree and in image buckets."""

import dataclasses
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array, Rows
from vnav.core.camera import CameraPrior, Intrinsics
from vnav.core.frame import Features
from vnav.core.map_index import spans_of
from vnav.core.tree import VocabularyTree
from vnav.errors import MapError
from vnav.localisation.inverted_file import InvertedFile

SAME_KEYPOINT_PX = 2.0  # a keypoint's second orientation lies nearer than this


@dataclass(frozen=True)
class Photo:
    """Features sorted along the tree, their ``paths`` (N, levels + 1) and each node's rows.

    ``camera``: of the image that the features were found in, without distortion.
    """

    features: Features
    paths: NDArray[np.int32]
    span: NDArray[np.int32]
    camera: CameraPrior

    @cached_property
    def inverted_file(self) -> InvertedFile:
        """The features, laid out for landmarks to be searched in them."""
        f = self.features
        return InvertedFile(f.descriptors, f.keypoints_px, SAME_KEYPOINT_PX, f.space)

    @property
    def intrinsics(self) -> Intrinsics:
        """Those of the camera; its focal length may be a guess."""
        return self.camera.intrinsics

    @property
    def pixel_scale(self) -> float:
        """A pixel of an image 640 wide, in pixels of this one: what thresholds are scaled by."""
        return max(self.intrinsics.size) / 640

    @cached_property
    def geometry(self) -> Array:
        """Of each feature (N, 4): x, y, log2 of its size, and angle from 0 to 2 pi."""
        f = self.features
        angle = f.angles_rad.astype(float) % (2 * np.pi)
        return np.column_stack([f.keypoints_px, np.log2(f.scales_px), angle]).astype(float)

    def buckets(self, edge_px: float) -> "Buckets":
        """The features in cells of that edge; those of the edges that were asked for are kept."""
        if edge_px not in self._bucketed:
            px, size = self.features.keypoints_px.astype(float), self.intrinsics.size
            self._bucketed[edge_px] = Buckets.filled(px, edge_px, size)
        return self._bucketed[edge_px]

    @cached_property
    def _bucketed(self) -> "dict[float, Buckets]":
        return {}


@dataclass(frozen=True)
class Buckets:
    """Points sorted by the square cell of the image that they lie in; a cell is around it, empty.

    ``order`` (N,): the points' numbers, ``start``: where in it each cell begins.
    """

    columns: int
    start: Rows
    order: Rows

    @classmethod
    def filled(cls, px: Array, edge_px: float, size: tuple[int, int]) -> "Buckets":
        """With points (N, 2) of an image; those outside are put into the nearest cell."""
        columns, rows = (int(extent / edge_px) + 3 for extent in size)
        cell = (np.floor(px / edge_px).astype(np.intp) + 1).clip(1, [columns - 2, rows - 2])
        bucket = cell[:, 1] * columns + cell[:, 0]
        order = np.argsort(bucket, kind="stable")
        start = np.append(0, np.cumsum(np.bincount(bucket, minlength=columns * rows)))
        return cls(columns, start, order)


def prepare(features: Features, camera: CameraPrior, tree: VocabularyTree) -> Photo:
    """Undistort, quantise and sort a photo's features (claim 4, 2.2).

    MapError where the map has features of another front-end.
    """
    if features.space != tree.space:
        raise MapError(
            f"expected the features of a photo to be those of the map, found {features.space};"
            f" those of the map are {tree.space}"
        )
    features, camera = _undistorted(features, camera)
    paths = tree.quantise(features.descriptors)
    order = np.lexsort(paths.T[::-1])
    paths = paths[order]
    span = spans_of(paths, len(tree.level))
    return Photo(features[order], paths, span, camera)


def _undistorted(features: Features, camera: CameraPrior) -> tuple[Features, CameraPrior]:
    k = camera.intrinsics
    if not any(k.distortion) or not len(features):
        return features, camera
    px = cv2.undistortPoints(features.keypoints_px[:, None], k.K, np.array(k.distortion), P=k.K)
    straight = dataclasses.replace(camera, intrinsics=dataclasses.replace(k, distortion=()))
    return dataclasses.replace(features, keypoints_px=px[:, 0]), straight
