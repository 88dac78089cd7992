"""Hierarchical k-means over the map's descriptors: the vocabulary tree (claim 4, 2.1).

Source: Nister, Stewenius, "Scalable recognition with a vocabulary tree", 2006.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import scipy.linalg  # noqa: F401  compiled code calls its BLAS, whose threads are limited if loaded
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.config import VocabularyConfig
from vnav.core.arrays import Floats, Rows
from vnav.core.descriptor_space import DescriptorSpace
from vnav.core.tree import VocabularyTree
from vnav.threads import one_blas_thread

MAX_ITERATIONS = 12  # of k-means at one node; an approximate tree quantises as well as an exact one
SETTLED = 1e-3  # share of descriptors that change their cluster: fewer are not waited for


@one_blas_thread
def grow(
    descriptors: NDArray[Any],
    space: DescriptorSpace,
    config: VocabularyConfig,
    rng: np.random.Generator,
) -> VocabularyTree:
    """Each node split by k-means, down to the words, which are the leaves.

    Nodes are split level by level, so that children lie side by side and levels ascend.
    """
    root = np.zeros((1, space.width), space.dtype)
    centres, first_child, children, level = [root], [0], [0], [0]
    nodes = [(0, np.arange(len(descriptors)))]

    def split(members: Rows, first: Rows) -> tuple[NDArray[Any], Rows]:
        return _split(descriptors[members], first, space)

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for depth in range(1, config.max_levels + 1):
            large = [(node, members) for node, members in nodes if len(members) >= config.min_leaf]
            firsts = [_drawn(len(members), config.branching, rng) for _, members in large]
            splits = pool.map(split, [members for _, members in large], firsts)
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
    """Means (k, D) of the clusters that are not empty, and the cluster (N,) of each descriptor.

    Clusters are those of the descriptors nearest to the means, the ones that quantising will use.
    """
    values = space.vectors(descriptors)
    means = space.nearest(_kmeans(values, values[first], MAX_ITERATIONS, SETTLED * len(values)))
    nearest = np.zeros(len(values), np.intp)
    _assign(values, space.vectors(means), nearest)
    used, label = np.unique(nearest, return_inverse=True)
    return means[used], label


@compiled
def _kmeans(values: Floats, centres: Floats, iterations: int, settled: float) -> Floats:
    """Centres (k, V) of values (N, V), by Lloyd's algorithm; one that nothing is near stays."""
    centres, nearest = centres.copy(), np.full(len(values), -1)
    total = np.zeros(centres.shape, np.float64)
    for _ in range(iterations):
        if _assign(values, centres, nearest) <= settled:
            break
        total[:] = 0
        count = np.zeros(len(centres))
        for n in range(len(values)):
            count[nearest[n]] += 1
            for v in range(values.shape[1]):
                total[nearest[n], v] += values[n, v]
        for k in range(len(centres)):
            if count[k]:
                for v in range(values.shape[1]):
                    centres[k, v] = total[k, v] / count[k]
    return centres


@compiled
def _assign(values: Floats, centres: Floats, nearest: Rows) -> int:
    """Fill in the row of the nearest centre to each value (N, V); how many have changed."""
    products, changed = np.dot(values, centres.T), 0
    half = np.zeros(len(centres), np.float32)
    for k in range(len(centres)):
        half[k] = np.dot(centres[k], centres[k]) / 2
    for n in range(len(values)):
        best = 0
        for k in range(1, len(centres)):
            if products[n, k] - half[k] > products[n, best] - half[best]:
                best = k
        changed += nearest[n] != best
        nearest[n] = best
    return changed
