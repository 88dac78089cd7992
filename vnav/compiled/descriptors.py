"""Distances between descriptors, as `DescriptorSpace.comparable` gives them."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled


def squared_distance(a: NDArray[Any], b: NDArray[Any]) -> float:
    """Sum of squared differences (D,), or of differing bits: for compiled code only."""
    raise NotImplementedError


def by_type(a: Any, b: Any) -> Callable[..., Any]:
    """What stands in compiled code for `squared_distance` of arrays of such types."""
    of: dict[str, Callable[..., Any]] = {"uint8": of_bytes, "uint64": _differing_bits}
    implementation = of.get(str(a.dtype), _of_floats)

    def of_type(a: Any, b: Any) -> Any:
        return implementation(a, b)

    return of_type


@compiled
def of_bytes(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> int:
    """Exact; without a way out of the loop, so that it is done many bytes at a time."""
    total = np.int32(0)
    for d in range(len(a)):
        difference = np.int32(a[d]) - np.int32(b[d])
        total += difference * difference
    return int(total)


@compiled
def _of_floats(a: NDArray[np.float32], b: NDArray[np.float32]) -> float:
    total = np.float32(0)
    for d in range(len(a)):
        total += (a[d] - b[d]) ** 2
    return float(total)


@compiled
def _differing_bits(a: NDArray[np.uint64], b: NDArray[np.uint64]) -> int:
    """Bits that are set in one only, counted in pairs, fours and eights (Warren 2012, 5-1)."""
    total = np.uint64(0)
    for d in range(len(a)):
        bits = a[d] ^ b[d]
        bits -= (bits >> np.uint64(1)) & np.uint64(0x5555555555555555)
        fours = np.uint64(0x3333333333333333)
        bits = (bits & fours) + ((bits >> np.uint64(2)) & fours)
        bits = (bits + (bits >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
        total += (bits * np.uint64(0x0101010101010101)) >> np.uint64(56)
    return int(total)
