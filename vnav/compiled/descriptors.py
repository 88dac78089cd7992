"""Distances between descriptors."""

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled


@compiled
def squared_distance(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> int:
    """Exact; without a way out of the loop, so that it is done many bytes at a time."""
    total = np.int32(0)
    for d in range(len(a)):
        difference = np.int32(a[d]) - np.int32(b[d])
        total += difference * difference
    return int(total)
