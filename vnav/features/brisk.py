"""BRISK: corners of a scale space with binary descriptors, one that CN 106940186 A names [0119].

Source: Leutenegger, Chli, Siegwart, "BRISK: binary robust invariant scalable keypoints", 2011.
"""

import threading
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.config import FeaturesConfig
from vnav.core.descriptor_space import DescriptorSpace
from vnav.core.frame import Features
from vnav.features.keypoints import (
    RESPONSE,
    features_of,
    keypoints_of,
    strongest_first,
    table_of,
)
from vnav.features.spread import spread

SPACE = DescriptorSpace("brisk", "uint8", 64, "hamming", typical=200.0)


class Brisk:
    """OpenCV's BRISK; corners are spread over the image."""

    space = SPACE

    def __init__(self, config: FeaturesConfig) -> None:
        self._config = config
        self._per_thread = threading.local()

    def extract(self, color: NDArray[np.uint8]) -> Features:
        """Features of an RGB image (H, W, 3), strongest first; none of one too small for BRISK."""
        gray = cv2.cvtColor(color, cv2.COLOR_RGB2GRAY)
        if min(gray.shape) < 2 ** (1 + self._config.brisk.octaves):
            return features_of(np.zeros((0, 6)), SPACE.none(), SPACE)
        found = table_of(self._detector.detect(gray, None))
        size = gray.shape[1], gray.shape[0]
        kept = found[spread(found[:, :2], found[:, RESPONSE], size, self._config.max_features)]
        keypoints, descriptors = self._detector.compute(gray, keypoints_of(kept))
        if descriptors is None:
            return features_of(np.zeros((0, 6)), SPACE.none(), SPACE)
        described = table_of(keypoints)
        order = strongest_first(described)
        return features_of(described[order], descriptors[order], SPACE)

    @property
    def _detector(self) -> Any:
        if not hasattr(self._per_thread, "detector"):
            config = self._config.brisk
            self._per_thread.detector = cv2.BRISK.create(config.threshold, config.octaves)
        return self._per_thread.detector
