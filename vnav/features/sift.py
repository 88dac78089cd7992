"""SIFT keypoints and RootSIFT descriptors."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.config import FeaturesConfig
from vnav.core.descriptor_space import DescriptorSpace
from vnav.core.frame import Features
from vnav.errors import VnavError
from vnav.features.keypoints import features_of, strongest_first, table_of
from vnav.threads import PerThread

ROOT_SCALE = 512.0  # RootSIFT has unit length; this puts it on the range of plain SIFT's bytes
SPACE = DescriptorSpace("sift", "uint8", 128, "l2", ROOT_SCALE)


class Sift:
    """SIFT (Lowe 2004) as in claim 3, S2; RootSIFT (Arandjelovic, Zisserman 2012) by choice."""

    space = SPACE

    def __init__(self, config: FeaturesConfig) -> None:
        self._config = config
        self._detectors = PerThread(lambda: _detectors(config))

    def extract(self, color: NDArray[np.uint8]) -> Features:
        """The strongest features of an RGB image (H, W, 3), strongest first."""
        gray = cv2.cvtColor(color, cv2.COLOR_RGB2GRAY)
        strong, weak = self._detectors()
        keypoints, descriptors = strong.detectAndCompute(gray, None)
        if len(keypoints) < self._config.sift.few_features:
            keypoints, descriptors = weak.detectAndCompute(gray, None)
        if descriptors is None:
            return features_of(table_of([]), SPACE.none(), SPACE)
        table = table_of(keypoints)
        order = strongest_first(table)[: self._config.max_features]
        if self._config.sift.root_sift:
            descriptors = root_sift(descriptors)
        return features_of(table[order], SPACE.nearest(descriptors[order]), SPACE)


def _detectors(config: FeaturesConfig) -> tuple[Any, ...]:
    """OpenCV's SIFT with either contrast threshold."""
    sift = config.sift
    return tuple(
        cv2.SIFT.create(
            nfeatures=config.max_features,
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
