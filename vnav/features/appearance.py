"""What a frame looks like as one vector, without a trained vocabulary and with one."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from vnav.core.frame import Features
from vnav.core.mapping import FrameFeatures
from vnav.core.tree import VocabularyTree

BITS = 12


def global_descriptor(features: Features) -> NDArray[np.float32]:
    """Unit histogram (2**BITS,) of the descriptors hashed by random hyperplanes; zeros if none.

    Two frames that show the same things have a large inner product (locality-sensitive hashing:
    Charikar 2002).
    """
    vectors = features.space.vectors(features.descriptors)
    planes = np.random.default_rng(0).standard_normal((vectors.shape[1], BITS))
    centred = vectors - vectors.mean(1, keepdims=True)
    words = ((centred @ planes) > 0) @ (1 << np.arange(BITS))
    counts = np.sqrt(np.bincount(words, minlength=2**BITS)).astype(np.float32)
    return np.asarray(counts / max(float(np.linalg.norm(counts)), 1e-9))


def tfidf_similarity(
    keyframes: Sequence[FrameFeatures], tree: VocabularyTree
) -> NDArray[np.float64]:
    """Cosine similarity (K, K) of the keyframes' TF-IDF vectors over the tree's leaves."""
    words = [tree.quantise(k.features.descriptors)[:, -1] for k in keyframes]
    rows = np.repeat(np.arange(len(words)), [len(w) for w in words])
    columns = np.concatenate(words)
    shape = (len(words), int(columns.max(initial=0)) + 1)
    counts = csr_array((np.ones(len(columns)), (rows, columns)), shape=shape)
    counts.sum_duplicates()
    seen_in = np.bincount(counts.indices, minlength=shape[1])
    weighted = counts * np.log(len(words) / np.maximum(seen_in, 1))
    length = np.sqrt(weighted.multiply(weighted).sum(1))
    similarity = np.asarray((weighted @ weighted.T).todense())
    return similarity / np.maximum(np.outer(length, length), 1e-12)
