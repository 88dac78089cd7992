"""Hierarchical k-means over the map's descriptors: the vocabulary tree (claim 4, 2.1).

Source: Nister, Stewenius, "Scalable recognition with a vocabulary tree", 2006.
"""

import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.config import VocabularyConfig
from vnav.core.descriptor_space import DescriptorSpace
from vnav.core.tree import VocabularyTree
from vnav.errors import VnavError
from vnav.threads import one_blas_thread, one_openmp_thread

MAX_ITERATIONS = 12  # of k-means at one node; an approximate tree quantises as well as an exact one


def grow(
    descriptors: NDArray[Any],
    space: DescriptorSpace,
    config: VocabularyConfig,
    rng: np.random.Generator,
) -> VocabularyTree:
    """Each node split by k-means, down to the words, which are the leaves."""
    import sklearn.cluster  # the limit of threads reaches only libraries that are loaded

    trusted = sklearn.config_context(assume_finite=True, skip_parameter_validation=True)
    with (
        one_blas_thread,
        one_openmp_thread,
        trusted,
    ):  # checks take a third of the time of a small node
        return _grown(descriptors, space, config, rng)


def self_test() -> None:
    """Raise VnavError where k-means does not separate two clusters."""
    low, high = np.full((20, 128), 10, np.uint8), np.full((20, 128), 200, np.uint8)
    bytes_of_128 = DescriptorSpace("", "uint8", 128, "l2", 1.0)
    config = VocabularyConfig(branching=2, max_levels=1, min_leaf=2)
    rng = np.random.default_rng(0)
    tree = grow(np.concatenate([low, high]), bytes_of_128, config, rng)
    words = tree.quantise(np.stack([low[0], high[0]]))[:, -1]
    if tree.words != 2 or words[0] == words[1]:
        raise VnavError("expected k-means to find two clusters; reinstall scikit-learn")


def _grown(
    descriptors: NDArray[Any],
    space: DescriptorSpace,
    config: VocabularyConfig,
    rng: np.random.Generator,
) -> VocabularyTree:
    """Split nodes breadth first, so that children lie side by side and levels ascend."""
    root = np.zeros((1, space.width), space.dtype)
    centres, first_child, children, level = [root], [0], [0], [0]
    queue = [(0, np.arange(len(descriptors)))]
    for node, members in queue:
        if level[node] == config.max_levels or len(members) < config.min_leaf:
            continue
        means, label = _split(descriptors[members], space, config.branching, rng)
        if len(means) < 2:
            continue
        first_child[node], children[node] = len(level), len(means)
        for k in range(len(means)):
            queue.append((len(level), members[label == k]))
            first_child.append(0)
            children.append(0)
            level.append(level[node] + 1)
        centres.append(means)
    return VocabularyTree(
        np.concatenate(centres),
        np.array(first_child, np.int32),
        np.array(children, np.int32),
        np.array(level, np.int32),
        space,
    )


def _split(
    descriptors: NDArray[Any], space: DescriptorSpace, branching: int, rng: np.random.Generator
) -> tuple[NDArray[Any], NDArray[np.intp]]:
    """Means (k, D) of at most ``branching`` non-empty clusters, and each descriptor's cluster.

    Clusters are those of the descriptors nearest to the means, the ones that quantising will use.
    """
    from sklearn.cluster import KMeans
    from sklearn.exceptions import ConvergenceWarning

    values = space.vectors(descriptors)
    start = values[rng.choice(len(values), min(branching, len(values)), replace=False)]
    kmeans = KMeans(len(start), init=start, n_init=1, max_iter=MAX_ITERATIONS)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # identical descriptors: fewer clusters
        kmeans.fit(values)
    means = space.nearest(kmeans.cluster_centers_)
    vectors = space.vectors(means)
    nearest = (values @ vectors.T - (vectors**2).sum(1) / 2).argmax(1)
    used, label = np.unique(nearest, return_inverse=True)
    return means[used], label
