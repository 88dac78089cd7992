"""Front-ends that find and describe features: one protocol, a plain registry, and matching."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vnav.config import FeaturesConfig
from vnav.config.registries import FRONT_ENDS, registered
from vnav.core.descriptor_space import DescriptorSpace
from vnav.core.frame import Features
from vnav.features.sift import self_test

__all__ = ["FrontEnd", "front_end", "self_test"]


class FrontEnd(Protocol):
    """Finds and describes features; may be called from several threads at once."""

    @property
    def space(self) -> DescriptorSpace:
        """What its descriptors are; its ``front_end`` is the name in the registry."""

    def extract(self, color: NDArray[np.uint8]) -> Features:
        """Features of an RGB image (H, W, 3); none on a blank image."""


def front_end(config: FeaturesConfig) -> FrontEnd:
    """The front-end that the configuration names."""
    made: FrontEnd = registered(FRONT_ENDS, config.front_end)(config)
    return made
