"""Points found by their descriptors, near where they are predicted."""

import numpy as np
from numpy.typing import NDArray

from vnav.config import Config
from vnav.core.arrays import Array, Floats
from vnav.core.frame import Features
from vnav.features import front_end
from vnav.features.matching import DescriptorMatcher


class DescriptorTracker:
    """Describes every image by the front-end, and takes the nearest descriptor."""

    def __init__(self, _color: NDArray[np.uint8], features: Features, config: Config) -> None:
        self._features = features
        self._extract = front_end(config.features).extract
        self._matcher = DescriptorMatcher(config.registration)
        self._radius_px = config.registration.search_radius_px

    def find(self, color: NDArray[np.uint8], predicted_px: Array) -> Floats:
        """See `Tracker`."""
        found = np.full((len(self._features), 2), np.nan, np.float32)
        seen = self._extract(color)
        rows = self._matcher.match_guided(self._features, seen, predicted_px, self._radius_px)
        found[rows[:, 0]] = seen.keypoints_px[rows[:, 1]]
        return found
