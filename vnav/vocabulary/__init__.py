"""The vocabulary tree of a map's descriptors, by one method or another (claim 4, 2.1)."""

from dataclasses import replace
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

    More than ``config.max_descriptors`` are subsampled: then each stands for several, and a leaf
    holds as many fewer. The same input and seed give the same tree whatever the number of threads.
    """
    rng = np.random.default_rng(seed)
    trained_on = _subsampled(descriptors, config.max_descriptors, rng)
    if len(trained_on) < len(descriptors):
        config = replace(config, min_leaf=_min_leaf(len(trained_on) / len(descriptors), config))
    grown = grow_flat if config.method == "approximate" else grow
    return grown(trained_on, space, config, rng)


def _min_leaf(share: float, config: VocabularyConfig) -> int:
    """Of a share of the descriptors: one for each branch, unless the settings ask for less."""
    return max(round(share * config.min_leaf), min(config.min_leaf, config.branching))


def _subsampled(descriptors: NDArray[Any], count: int, rng: np.random.Generator) -> NDArray[Any]:
    if len(descriptors) <= count:
        return descriptors
    return descriptors[np.sort(rng.choice(len(descriptors), count, replace=False))]
