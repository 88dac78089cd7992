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
from vnav.localisation.words import Database, half_norms

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
        descriptors = self.features.descriptors
        position = self.features.keypoints_px
        return Database(descriptors, half_norms(descriptors), position, SAME_KEYPOINT_PX)

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
        columns, rows = (int(extent / radius_px) + 3 for extent in self.intrinsics.size)
        cell = np.floor(self.features.keypoints_px / radius_px).astype(np.intp) + 1
        cell = cell.clip(1, [columns - 2, rows - 2])
        bucket = cell[:, 1] * columns + cell[:, 0]
        order = np.argsort(bucket, kind="stable")
        start = np.append(0, np.cumsum(np.bincount(bucket, minlength=columns * rows)))
        centre = np.floor(px / radius_px).astype(np.intp) + 1
        centre = centre[:, 1] * columns + centre[:, 0]
        # Three cells side by side are one run of the sorted features.
        first = (centre[:, None] + columns * np.array([-1, 0, 1])).ravel()
        source, place = ranges(start[first - 1], start[first + 2])
        feature = order[place]
        offset = self.features.keypoints_px[feature] - px[source // 3]
        close = np.einsum("ij,ij->i", offset, offset) < radius_px**2
        return source[close] // 3, feature[close]


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
