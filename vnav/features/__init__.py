"""Front-ends that find and describe features: one protocol, a plain registry, and matching."""

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vnav.config import FeaturesConfig
from vnav.core.frame import Features
from vnav.features.sift import Sift, self_test

__all__ = ["FRONT_ENDS", "FrontEnd", "front_end", "self_test"]


class FrontEnd(Protocol):
    """Finds and describes features; may be called from several threads at once."""

    def extract(self, color: NDArray[np.uint8]) -> Features:
        """Features of an RGB image (H, W, 3); none on a blank image."""


FRONT_ENDS: dict[str, Callable[[FeaturesConfig], FrontEnd]] = {"sift": Sift}


def front_end(config: FeaturesConfig) -> FrontEnd:
    """The front-end that the configuration names."""
    return FRONT_ENDS[config.front_end](config)
