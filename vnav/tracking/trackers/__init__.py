"""Trackers, which find the points of one image in another: one protocol, a plain registry."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vnav.config import Config
from vnav.config.registries import TRACKERS, registered
from vnav.core.arrays import Array, Floats
from vnav.core.frame import Features

__all__ = ["Tracker", "tracker"]


class Tracker(Protocol):
    """Finds the points of one image in later ones."""

    def find(self, color: NDArray[np.uint8], predicted_px: Array) -> Floats:
        """Where a later image shows each point: pixels (N, 2), NaN for those not found.

        ``predicted_px`` (N, 2): where they should be, NaN for those with no place there.
        """


def tracker(color: NDArray[np.uint8], features: Features, config: Config) -> Tracker:
    """The tracker that the configuration names, of an image's keypoints."""
    made: Tracker = registered(TRACKERS, config.tracking.method)(color, features, config)
    return made
