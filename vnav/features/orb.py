"""ORB: FAST corners of an image pyramid, spread over the image, with turned BRIEF descriptors.

Sources: [004 section 2.1]; Rublee, Rabaud, Konolige, Bradski, "ORB: an efficient alternative to
SIFT or SURF", 2011; Mur-Artal, Montiel, Tardos, "ORB-SLAM", 2015.
"""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.config import FeaturesConfig
from vnav.core.arrays import Array, Rows
from vnav.core.descriptor_space import DescriptorSpace
from vnav.core.frame import Features
from vnav.features.keypoints import LEVEL, RESPONSE, described, features_of, table_of
from vnav.features.spread import spread
from vnav.threads import PerThread

PATCH_PX = 31  # edge of the described patch, at the pyramid's first level
POOL = 6  # corners that are found, of those that are kept
ALL = 1_000_000  # corners: in the dark the strong ones are weaker than most in the light
CELL_PX = 32  # where a cell has no strong corner, weak ones are taken
SPACE = DescriptorSpace("orb", "uint8", 32, "hamming", typical=110.0)


class Orb:
    """OpenCV's ORB finds and describes; which corners are kept is decided here."""

    space = SPACE

    def __init__(self, config: FeaturesConfig) -> None:
        self._config = config
        self._detector = PerThread(lambda: _detector(config))

    def extract(self, color: NDArray[np.uint8]) -> Features:
        """Features of an RGB image (H, W, 3), strongest first."""
        gray = cv2.cvtColor(color, cv2.COLOR_RGB2GRAY)
        size = gray.shape[1], gray.shape[0]
        found = table_of(self._detector().detect(gray, None))
        found = found[self._strong_enough(found, gray)]
        kept = found[self._spread(found, size)]
        table, descriptors = described(self._detector(), gray, kept, SPACE)
        return features_of(self._centred(table, size), descriptors, SPACE)

    def _strong_enough(self, found: Array, gray: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Which corners (N,) are strong, or the best that their cell has [004 section 2.1]."""
        orb = self._config.orb
        if orb.relative_threshold:
            return found[:, RESPONSE] >= orb.relative_threshold * self._brightness(found, gray)
        strong = found[:, RESPONSE] >= orb.threshold
        cells = (found[:, :2] // CELL_PX).astype(int)
        cell = cells[:, 1] * (1 + cells[:, 0].max(initial=0)) + cells[:, 0]
        return np.asarray(strong | ~np.isin(cell, cell[strong]))

    def _brightness(self, found: Array, gray: NDArray[np.uint8]) -> Array:
        """Grey level (N,) of each corner in the image of its level."""
        bright = np.zeros(len(found))
        for level in range(self._config.orb.levels):
            rows, scale = found[:, LEVEL] == level, self._config.orb.scale_factor**level
            size = np.rint(np.array(gray.shape[::-1]) / scale).astype(int)
            image = cv2.resize(gray, size.tolist(), interpolation=cv2.INTER_LINEAR_EXACT)
            x, y = np.minimum(np.rint(found[rows, :2] / scale).astype(int), size - 1).T
            bright[rows] = image[y, x]
        return bright

    def _spread(self, found: Array, size: tuple[int, int]) -> Rows:
        """Rows that are kept, of each level its share: the finer a level, the more."""
        shares = np.cumsum(self._config.orb.scale_factor ** -np.arange(self._config.orb.levels))
        upto = np.rint(self._config.max_features * shares / shares[-1]).astype(int)
        kept = [np.zeros(0, np.intp)]
        for level, count in enumerate(np.diff(upto, prepend=0)):
            rows = np.flatnonzero(found[:, LEVEL] == level)
            kept.append(rows[spread(found[rows, :2], found[rows, RESPONSE], size, count)])
        return np.concatenate(kept)

    def _centred(self, table: Array, size: tuple[int, int]) -> Array:
        """The table with keypoints where a pixel of their level has its centre.

        OpenCV takes its corner, and does not allow for levels of whole pixels.
        """
        scale = self._config.orb.scale_factor ** table[:, LEVEL, None]
        level_pixel = table[:, :2] / scale
        px = (level_pixel + 0.5) * size / np.rint(size / scale) - 0.5
        return np.hstack([px, table[:, 2:]])


def _detector(config: FeaturesConfig) -> Any:
    """OpenCV's ORB, which finds more corners than are kept."""
    is_relative = bool(config.orb.relative_threshold)
    return cv2.ORB.create(
        nfeatures=ALL if is_relative else POOL * config.max_features,
        scaleFactor=config.orb.scale_factor,
        nlevels=config.orb.levels,
        patchSize=PATCH_PX,
        edgeThreshold=PATCH_PX // 2 + 1,
        scoreType=cv2.ORB_FAST_SCORE,
        fastThreshold=1 if is_relative else config.orb.weak_threshold,
    )
