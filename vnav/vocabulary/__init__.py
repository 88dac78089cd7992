"""The vocabulary tree of a map's descriptors, by one method or another (claim 4, 2.1)."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.config import VocabularyConfig
from vnav.core.descriptor_space import DescriptorSpace
from vnav.core.tree import VocabularyTree
from vnav.vocabulary.approximate import grow_flat
from vnav.vocabulary.hierarchical import grow, self_test

__all__ = ["self_test", "train"]


def train(
    descriptors: NDArray[Any], space: DescriptorSpace, config: VocabularyConfig, seed: int
) -> VocabularyTree:
    """The tree of descriptors (N, D); N = 0 gives a root alone, where all share one word.

    More than ``config.max_descriptors`` are subsampled. The same input and seed give the same
    tree whatever the number of threads.
    """
    rng = np.random.default_rng(seed)
    descriptors = _subsampled(descriptors, config.max_descriptors, rng)
    grown = grow_flat if config.method == "approximate" else grow
    return grown(descriptors, space, config, rng)


def _subsampled(descriptors: NDArray[Any], count: int, rng: np.random.Generator) -> NDArray[Any]:
    if len(descriptors) <= count:
        return descriptors
    return descriptors[np.sort(rng.choice(len(descriptors), count, replace=False))]
