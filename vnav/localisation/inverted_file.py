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
    """The ``count`` nearest rows of the file (Q, count) in each query's ranges, and distances.

    ``queries`` (Q, W), ``span`` (Q, 2) or (Q, R, 2): of each query one is not empty. Each row lies
    elsewhere than the nearer ones; where there are no more, the distance is inf. Linear search, as
    in claim 4, 2.4.
    """
    span = span[:, None] if span.ndim == 2 else span
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
    most = (span[:, :, 1] - span[:, :, 0]).sum(1).max() if len(span) else 0
    row_of, left = np.empty(most, np.intp), np.empty(most, np.float32)
    for q in range(len(queries)):
        size = 0
        for begin, end in span[q]:
            for row in range(begin, end):
                row_of[size], left[size] = row, squared_distance(queries[q], descriptors[row])
                size += 1
        rows[q] = row_of[0]
        for k in range(count):
            nearest = left[:size].argmin()
            if left[nearest] == np.inf:
                break
            found = row_of[nearest]
            rows[q, k], squared[q, k] = found, left[nearest]
            if k == count - 1:
                break
            for n in range(size):
                for d in range(position.shape[1]):
                    if not abs(position[row_of[n], d] - position[found, d]) < same_within:
                        break
                else:
                    left[n] = np.inf
    return rows, squared
