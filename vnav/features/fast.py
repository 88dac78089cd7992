"""Improved FAST corners [000 section 1] with BRIEF descriptors, whose turn and scale are unknown.

Sources: [000 eq 1 to 3]; Calonder, Lepetit, Strecha, Fua, "BRIEF: binary robust independent
elementary features", 2010.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.config import FeaturesConfig
from vnav.core.descriptor_space import DescriptorSpace
from vnav.core.frame import Features
from vnav.features.keypoints import RESPONSE, SIZE, described, features_of
from vnav.features.segment_test import corners
from vnav.features.spread import spread
from vnav.threads import PerThread

PATCH_PX = 48  # edge of BRIEF's patch
BRIEF_BYTES = 32
SPACE = DescriptorSpace(
    "fast", "uint8", BRIEF_BYTES, "hamming", typical=110.0, has_angles=False, has_scales=False
)


class Fast:
    """Corners of the image as it is, spread over it."""

    space = SPACE

    def __init__(self, config: FeaturesConfig) -> None:
        self._config = config
        self._describer = PerThread(
            lambda: cv2.xfeatures2d.BriefDescriptorExtractor.create(BRIEF_BYTES)
        )

    def extract(self, color: NDArray[np.uint8]) -> Features:
        """Features of an RGB image (H, W, 3), strongest first."""
        gray = np.asarray(cv2.cvtColor(color, cv2.COLOR_RGB2GRAY), np.uint8)
        config, size = self._config.fast, (gray.shape[1], gray.shape[0])
        px, strength = corners(gray, config.threshold, config.arc, config.edge_limit)
        inside = ((px >= PATCH_PX / 2) & (px < np.array(size) - PATCH_PX / 2)).all(1)
        px, strength = px[inside], strength[inside]
        kept = spread(px, strength, size, self._config.max_features)
        table = np.zeros((len(kept), 6))
        table[:, :2], table[:, RESPONSE], table[:, SIZE] = px[kept], strength[kept], PATCH_PX
        return features_of(*described(self._describer(), gray, table, SPACE), SPACE)
