"""Hierarchical k-means over the map's descriptors: the vocabulary tree (claim 4, 2.1).

Source: Nister, Stewenius, "Scalable recognition with a vocabulary tree", 2006.
"""

import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.config import VocabularyConfig
from vnav.core.arrays import Rows
from vnav.core.descriptor_space import DescriptorSpace
from vnav.core.tree import VocabularyTree
from vnav.errors import VnavError
from vnav.threads import one_blas_thread, openmp_free_pool

MAX_ITERATIONS = 12  # of k-means at one node; an approximate tree quantises as well as an exact one


def grow(
    descriptors: NDArray[Any],
    space: DescriptorSpace,
    config: VocabularyConfig,
    rng: np.random.Generator,
) -> VocabularyTree:
    """Each node split by k-means, down to the words, which are the leaves."""
    import sklearn.cluster  # the limit of threads reaches only libraries that are loaded

    unsettled = sklearn.exceptions.ConvergenceWarning  # identical descriptors: fewer clusters
    with one_blas_thread, warnings.catch_warnings():
        warnings.simplefilter("ignore", unsettled)
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
    """Split nodes level by level, so that children lie side by side and levels ascend.

    The nodes of a level are split side by side; what is drawn for them is drawn in their order.
    """
    root = np.zeros((1, space.width), space.dtype)
    centres, first_child, children, level = [root], [0], [0], [0]
    nodes = [(0, np.arange(len(descriptors)))]

    def split(members: Rows, first: Rows) -> tuple[NDArray[Any], Rows]:
        return _split(descriptors[members], first, space)

    with openmp_free_pool() as pool:
        for depth in range(1, config.max_levels + 1):
            large = [(node, members) for node, members in nodes if len(members) >= config.min_leaf]
            members_of = [members for _, members in large]
            firsts = [_drawn(len(members), config.branching, rng) for members in members_of]
            splits = pool.map(split, members_of, firsts)
            nodes = []
            for (node, members), (means, label) in zip(large, splits, strict=True):
                if len(means) < 2:
                    continue
                first_child[node], children[node] = len(level), len(means)
                nodes += [(len(level) + k, members[label == k]) for k in range(len(means))]
                first_child += [0] * len(means)
                children += [0] * len(means)
                level += [depth] * len(means)
                centres.append(means)
    return VocabularyTree(
        np.concatenate(centres),
        np.array(first_child, np.int32),
        np.array(children, np.int32),
        np.array(level, np.int32),
        space,
    )


def _drawn(count: int, branching: int, rng: np.random.Generator) -> Rows:
    """Rows of the descriptors that k-means starts from."""
    return rng.choice(count, min(branching, count), replace=False)


def _split(
    descriptors: NDArray[Any], first: Rows, space: DescriptorSpace
) -> tuple[NDArray[Any], Rows]:
    """Means (k, D) of clusters that are not empty, and the cluster (N,) of each descriptor.

    Clusters are those of the descriptors nearest to the means, the ones that quantising will use.
    """
    import sklearn
    from sklearn.cluster import KMeans

    values = space.vectors(descriptors)
    kmeans = KMeans(len(first), init=values[first], n_init=1, max_iter=MAX_ITERATIONS)
    # Checks take a third of the time of a small node; each thread has settings of its own.
    with sklearn.config_context(assume_finite=True, skip_parameter_validation=True):
        kmeans.fit(values)
    means = space.nearest(kmeans.cluster_centers_)
    vectors = space.vectors(means)
    nearest = (values @ vectors.T - (vectors**2).sum(1) / 2).argmax(1)
    used, label = np.unique(nearest, return_inverse=True)
    return means[used], label
