"""Nearest descriptors of bits; compiled, since every frame compares all its own."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.compiled.descriptors import squared_distance
from vnav.core.arrays import Array, Rows


@compiled
def two_nearest_bits(a: NDArray[Any], b: NDArray[Any]) -> tuple[Rows, Array, Array]:
    """For each row of a the nearest of b, and the differing bits of the two nearest.

    Descriptors as `DescriptorSpace.comparable` gives them; the first row of those alike.
    """
    nearest = np.zeros(len(a), np.intp)
    first, second = np.full(len(a), np.inf), np.full(len(a), np.inf)
    for i in range(len(a)):
        for j in range(len(b)):
            bits = squared_distance(a[i], b[j])
            if bits < first[i]:
                nearest[i], first[i], second[i] = j, bits, first[i]
            elif bits < second[i]:
                second[i] = bits
    return nearest, first, second
