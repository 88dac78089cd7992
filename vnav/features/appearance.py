"""What a frame looks like as one vector, without a trained vocabulary."""

import numpy as np
from numpy.typing import NDArray

from vnav.core.frame import Features

BITS = 12


def signature(features: Features) -> NDArray[np.float32]:
    """Unit histogram (2**BITS,) of the descriptors hashed by random hyperplanes; zeros if none.

    Two frames that show the same things have a large inner product (locality-sensitive hashing:
    Charikar 2002).
    """
    planes = np.random.default_rng(0).standard_normal((features.descriptors.shape[1], BITS))
    centred = features.descriptors.astype(np.float32)
    centred -= centred.mean(1, keepdims=True)
    words = ((centred @ planes) > 0) @ (1 << np.arange(BITS))
    counts = np.sqrt(np.bincount(words, minlength=2**BITS)).astype(np.float32)
    return np.asarray(counts / max(float(np.linalg.norm(counts)), 1e-9))
