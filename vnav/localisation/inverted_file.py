"""Nearest descriptors among those that share a word; compiled: only few pairs share one."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.compiled.descriptors import squared_distance
from vnav.core.arrays import Floats, Rows, frozen
from vnav.core.descriptor_space import DescriptorSpace


@dataclass(frozen=True)
class InvertedFile:
    """Descriptors (D, W) of a space in the order of the tree's leaves, and where each lies.

    Two descriptors whose ``position`` (D, k) differs by less than ``same_within`` in every
    coordinate may be of the same point: one is no second-nearest of the other.
    """

    descriptors: NDArray[Any]
    position: Floats
    same_within: float
    space: DescriptorSpace

    def __post_init__(self) -> None:
        n = len(self.descriptors)
        object.__setattr__(
            self, "descriptors", frozen(self.descriptors, self.space.dtype, (n, None))
        )
        object.__setattr__(self, "position", frozen(self.position, np.float32, (n, None)))


def nearest_distinct(
    queries: NDArray[Any], span: NDArray[np.int32], file: InvertedFile, count: int
) -> tuple[Rows, Floats]:
    """The ``count`` nearest rows of the file (Q, count) in each query's range, and distances.

    ``queries`` (Q, W), ``span`` (Q, 2), none empty. Each row lies elsewhere than the nearer ones;
    where there are no more, the distance is inf. Linear search, as in claim 4, 2.4.
    """
    queries, descriptors = map(file.space.comparable, (queries, file.descriptors))
    rows, squared = _nearest_distinct(
        queries, span, descriptors, file.position, file.same_within, count
    )
    return rows, file.space.distance(squared)


@compiled
def _nearest_distinct(
    queries: NDArray[Any],
    span: NDArray[np.int32],
    descriptors: NDArray[Any],
    position: Floats,
    same_within: float,
    count: int,
) -> tuple[Rows, Floats]:
    rows = np.empty((len(queries), count), np.intp)
    squared = np.full((len(queries), count), np.inf, np.float32)
    left = np.empty((span[:, 1] - span[:, 0]).max() if len(span) else 0, np.float32)
    for q in range(len(queries)):
        begin, end = span[q]
        rows[q] = begin
        for row in range(begin, end):
            left[row - begin] = squared_distance(queries[q], descriptors[row])
        for k in range(count):
            nearest = begin + left[: end - begin].argmin()
            if left[nearest - begin] == np.inf:
                break
            rows[q, k], squared[q, k] = nearest, left[nearest - begin]
            for row in range(begin, end):
                for d in range(position.shape[1]):
                    if not abs(position[row, d] - position[nearest, d]) < same_within:
                        break
                else:
                    left[row - begin] = np.inf
    return rows, squared
