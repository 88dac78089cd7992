"""SIFT keypoints and RootSIFT descriptors."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.config import FeaturesConfig
from vnav.core.arrays import Array
from vnav.core.descriptor_space import DescriptorSpace
from vnav.core.frame import Features
from vnav.errors import VnavError
from vnav.features.keypoints import RESPONSE, features_of, strongest_first, table_of
from vnav.threads import PerThread

ROOT_SCALE = 512.0  # RootSIFT has unit length; this puts it on the range of plain SIFT's bytes
OCTAVE_LAYERS = 3  # contrast is a keypoint's response times these
SPACE = DescriptorSpace("sift", "uint8", 128, "l2", ROOT_SCALE)


class Sift:
    """SIFT (Lowe 2004) as in claim 3, S2; RootSIFT (Arandjelovic, Zisserman 2012) by choice."""

    space = SPACE

    def __init__(self, config: FeaturesConfig) -> None:
        self._config = config
        self._detectors = PerThread(lambda: _detectors(config))
        self._was_faint: dict[tuple[int, ...], bool] = {}  # the last image, by its size

    def extract(self, color: NDArray[np.uint8]) -> Features:
        """The strongest features of an RGB image (H, W, 3), strongest first."""
        table, descriptors = self._found(cv2.cvtColor(color, cv2.COLOR_RGB2GRAY))
        if not len(table):
            return features_of(table, SPACE.none(), SPACE)
        order = strongest_first(table)[: self._config.max_features]
        descriptors = descriptors[order]
        if self._config.sift.root_sift:
            descriptors = root_sift(descriptors)
        return features_of(table[order], SPACE.nearest(descriptors), SPACE)

    def _found(self, gray: NDArray[np.uint8]) -> tuple[Array, NDArray[np.float32]]:
        """Keypoints and descriptors with enough contrast; where these are few, the weak, too.

        A weak search finds those of the strong one as well, so either may be made first: the image
        before tells which, for those of a video are alike.
        """
        (strong, weak), sift = self._detectors(), self._config.sift
        was_faint = self._was_faint.get(gray.shape, False)
        table, descriptors = _searched(weak if was_faint else strong, gray)
        is_strong = OCTAVE_LAYERS * table[:, RESPONSE] >= np.float32(sift.contrast_threshold)
        is_faint = is_strong.sum() < sift.few_features
        self._was_faint[gray.shape] = bool(is_faint)
        if is_faint and not was_faint:
            return _searched(weak, gray)
        if was_faint and not is_faint:
            return table[is_strong], descriptors[is_strong]
        return table, descriptors


def _searched(detector: Any, gray: NDArray[np.uint8]) -> tuple[Array, NDArray[np.float32]]:
    """The keypoints (N, 6) of an image, as a table, and their descriptors (N, 128)."""
    keypoints, descriptors = detector.detectAndCompute(gray, None)
    if descriptors is None:
        return table_of([]), np.zeros((0, SPACE.width), np.float32)
    return table_of(keypoints), descriptors


def _detectors(config: FeaturesConfig) -> tuple[Any, ...]:
    """OpenCV's SIFT with either contrast threshold."""
    sift = config.sift
    return tuple(
        cv2.SIFT.create(
            nfeatures=config.max_features,
            nOctaveLayers=OCTAVE_LAYERS,
            contrastThreshold=contrast,
            edgeThreshold=sift.edge_threshold,
            enable_precise_upscale=True,  # without it keypoints sit a quarter pixel off
        )
        for contrast in (sift.contrast_threshold, sift.weak_contrast_threshold)
    )


def root_sift(descriptors: NDArray[np.float32]) -> NDArray[np.float32]:
    """Square roots of the L1-normalised descriptors (N, 128), scaled to fit into bytes."""
    total = np.maximum(descriptors.sum(1, keepdims=True), 1e-9)
    return np.asarray(ROOT_SCALE * np.sqrt(descriptors / total))


def self_test() -> None:
    """Raise VnavError where OpenCV's SIFT does not find a bright disc at its centre."""
    image = np.zeros((96, 128, 3), np.uint8)
    cv2.circle(image, (70, 40), 9, (255, 255, 255), -1)
    found = Sift(FeaturesConfig()).extract(image)
    if not len(found) or np.linalg.norm(found.keypoints_px - (70, 40), axis=1).min() > 1.0:
        raise VnavError(
            "expected SIFT to find a bright disc, found none; reinstall"
            " opencv-contrib-python-headless"
        )
