"""BRISK: corners of a scale space with binary descriptors, one that CN 106940186 A names [0119].

Source: Leutenegger, Chli, Siegwart, "BRISK: binary robust invariant scalable keypoints", 2011.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.config import FeaturesConfig
from vnav.core.descriptor_space import DescriptorSpace
from vnav.core.frame import Features
from vnav.features.keypoints import RESPONSE, described, features_of, table_of
from vnav.features.spread import spread
from vnav.threads import PerThread

SPACE = DescriptorSpace("brisk", "uint8", 64, "hamming", typical=200.0)


class Brisk:
    """OpenCV's BRISK; corners are spread over the image."""

    space = SPACE

    def __init__(self, config: FeaturesConfig) -> None:
        self._config = config
        brisk = config.brisk
        self._detector = PerThread(lambda: cv2.BRISK.create(brisk.threshold, brisk.octaves))

    def extract(self, color: NDArray[np.uint8]) -> Features:
        """Features of an RGB image (H, W, 3), strongest first; none of one too small for BRISK."""
        gray = cv2.cvtColor(color, cv2.COLOR_RGB2GRAY)
        if min(gray.shape) < 2 ** (1 + self._config.brisk.octaves):
            return features_of(np.zeros((0, 6)), SPACE.none(), SPACE)
        found = table_of(self._detector().detect(gray, None))
        size = gray.shape[1], gray.shape[0]
        kept = found[spread(found[:, :2], found[:, RESPONSE], size, self._config.max_features)]
        return features_of(*described(self._detector(), gray, kept, SPACE), SPACE)
