"""Approximate k-means over the map's descriptors: flat words (claim 4, 2.1; [0123]).

Source: Philbin, Chum, Isard, Sivic, Zisserman, "Object retrieval with large vocabularies and fast
spatial matching", 2007. The randomised kd-trees are those of FLANN (Muja, Lowe 2009) in OpenCV.
"""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.config import VocabularyConfig
from vnav.core.arrays import Floats
from vnav.core.descriptor_space import DescriptorSpace
from vnav.core.tree import VocabularyTree
from vnav.errors import ConfigError

MEMBERS = 16  # descriptors of a word, at least, on the average: as many as Philbin et al. have
MAX_ITERATIONS = 8
TREES, CHECKS = 4, 48  # of the forest, and centres that are compared with one descriptor
KDTREE = 1  # FLANN's number of randomised kd-trees
BATCH = 10_000  # descriptors that one thread assigns at once
PATHS = 10  # that are followed to the nearest word
Label = NDArray[np.intp]


def grow_flat(
    descriptors: NDArray[Any],
    space: DescriptorSpace,
    config: VocabularyConfig,
    rng: np.random.Generator,
) -> VocabularyTree:
    """Words of one flat vocabulary, which are the leaves; coarser levels cluster their centres.

    Levels grow by one factor from the root to the words, so that there are ``config.max_levels`` of
    them unless words are few. ConfigError for bits, which kd-trees cannot hold.
    """
    expect_numbers(space)
    levels, parents = list[NDArray[Any]](), list[Label]()  # the words first
    for count in _sizes(len(descriptors), config):
        descriptors, label = approximate_kmeans(descriptors, count, space, rng)
        levels.append(descriptors)
        parents.append(label)
    of_root = [np.zeros(len(level), np.intp) for level in levels[-1:]]
    return _tree(levels[::-1], [*of_root, *parents[:0:-1]], space)


def expect_numbers(space: DescriptorSpace) -> None:
    """ConfigError where descriptors are bits."""
    if space.packed:
        raise ConfigError(
            "expected vocabulary.method=hierarchical where descriptors are bits, which kd-trees"
            f" cannot hold, found approximate with features.front_end={space.front_end}"
        )


def approximate_kmeans(
    descriptors: NDArray[Any], count: int, space: DescriptorSpace, rng: np.random.Generator
) -> tuple[NDArray[Any], Label]:
    """Means (k, D) of at most ``count`` clusters, and the cluster (N,) of each descriptor."""
    values = space.vectors(descriptors)
    centres = values[np.sort(rng.choice(len(values), min(count, len(values)), replace=False))]
    for _ in range(MAX_ITERATIONS):
        centres = _means(values, _nearest(centres, values, rng))
    means = space.nearest(centres)
    used, label = np.unique(_nearest(space.vectors(means), values, rng), return_inverse=True)
    return means[used], label


def _sizes(descriptors: int, config: VocabularyConfig) -> list[int]:
    """Clusters of each level, those of the words first; none where there are too few for two."""
    words, levels = min(config.words, descriptors // MEMBERS), config.max_levels
    sizes = {round(words ** (level / levels)) for level in range(1, levels + 1)}
    return sorted((size for size in sizes if size > 1), reverse=True)


def _nearest(centres: Floats, values: Floats, rng: np.random.Generator) -> Label:
    """The row of a centre near each value (N,), in nearly all cases the nearest.

    Each value is asked by itself, so that the number of threads does not matter.
    """
    cv2.setRNGSeed(int(rng.integers(2**31)))  # of this thread, which makes the forest
    forest = cv2.flann.Index(centres, {"algorithm": KDTREE, "trees": TREES})

    def ask(part: Floats) -> NDArray[np.int32]:
        return np.asarray(forest.knnSearch(part, 1, params={"checks": CHECKS})[0][:, 0])

    parts = [values[start : start + BATCH] for start in range(0, len(values), BATCH)]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return np.concatenate(list(pool.map(ask, parts))).astype(np.intp)


def _means(values: Floats, label: Label) -> Floats:
    """The mean (k, D) of the values of each label that there is."""
    order = np.argsort(label, kind="stable")
    first = np.flatnonzero(np.diff(label[order], prepend=-1))
    count = np.diff(np.append(first, len(order)))[:, None]
    return np.asarray(np.add.reduceat(values[order], first) / count, np.float32)


def _tree(
    levels: Sequence[NDArray[Any]], parents: Sequence[Label], space: DescriptorSpace
) -> VocabularyTree:
    """Nodes level by level below a root; ``parents``: of each level's nodes in the level above."""
    nodes = [np.zeros((1, space.width), space.dtype)]
    first_child, children, level_of = [], [], [np.zeros(1, np.int32)]
    place, below = np.zeros(1, np.intp), 1  # of the level above: where each node stands; next node
    for depth, (centres, parent) in enumerate(zip(levels, parents, strict=True), 1):
        count = np.bincount(place[parent], minlength=len(place))
        children.append(count)
        first_child.append(below + np.cumsum(count) - count)
        order = np.argsort(place[parent], kind="stable")
        nodes.append(centres[order])
        level_of.append(np.full(len(order), depth, np.int32))
        place, below = np.argsort(order), below + len(order)
    leaves = np.zeros(len(place), np.intp)
    return VocabularyTree(
        np.concatenate(nodes),
        np.concatenate([*first_child, leaves]).astype(np.int32),
        np.concatenate([*children, leaves]).astype(np.int32),
        np.concatenate(level_of),
        space,
        PATHS,
    )
