"""Nearest descriptors among those that share a word."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.core.map_index import ranges

Floats = NDArray[np.float32]
Rows = NDArray[np.intp]


@dataclass(frozen=True)
class Database:
    """Descriptors (D, 128) uint8 in the order of the tree's leaves, and where each lies.

    Two descriptors whose ``position`` (D, k) differs by less than ``apart`` in every coordinate
    may be of the same thing: one is no rival of the other. ``half_norm`` (D,): half the squared
    length of each.
    """

    descriptors: NDArray[np.uint8]
    half_norm: Floats
    position: Floats
    apart: float


def half_norms(descriptors: NDArray[np.uint8]) -> Floats:
    """Half the squared length (D,) of each descriptor, exact."""
    values = descriptors.astype(np.float32)
    return np.asarray(np.einsum("ij,ij->i", values, values) / 2)


def nearest_apart(
    queries: NDArray[np.uint8], span: NDArray[np.int32], database: Database, count: int
) -> tuple[Rows, Floats]:
    """The ``count`` nearest rows of the database (Q, count) in each query's range, and distances.

    ``queries`` (Q, 128), ``span`` (Q, 2), none empty. Each row lies elsewhere than the nearer ones;
    where there are no more, the distance is inf. Linear search, as in claim 4, 2.4.
    """
    order = np.argsort(span[:, 0], kind="stable")
    rows, squared = _nearest_apart(queries[order], span[order], database, count)
    back = np.argsort(order)
    return rows[back], np.sqrt(squared[back])


def _nearest_apart(
    queries: NDArray[np.uint8], span: NDArray[np.int32], database: Database, count: int
) -> tuple[Rows, Floats]:
    """The same for queries in order of their range, with squared distances."""
    source, row = ranges(span[:, 0], span[:, 1])
    squared = _squared_distances(queries, span, database, len(row))
    first = np.append(0, np.cumsum(span[:, 1] - span[:, 0])[:-1])
    nearest, least = [], []
    for _ in range(count):
        least.append(np.minimum.reduceat(squared, first))
        at = np.flatnonzero(squared == least[-1][source])
        nearest.append(row[at[np.append(True, source[at][1:] != source[at][:-1])]])
        near = np.ones(len(row), bool)
        for x in database.position.T:
            near &= np.abs(x[row] - x[nearest[-1]][source]) < database.apart
        squared[near] = np.inf
    return np.stack(nearest, 1), np.stack(least, 1)


def _squared_distances(
    queries: NDArray[np.uint8], span: NDArray[np.int32], database: Database, total: int
) -> Floats:
    """All of a query's squared distances, query after query; queries of one word in one product.

    Exact in float32: sums of products of bytes stay below 2^24.
    """
    values, half_norm = queries.astype(np.float32), half_norms(queries)
    squared = np.empty(total, np.float32)
    starts = np.flatnonzero(np.append(True, span[1:, 0] != span[:-1, 0]))
    end = 0
    for low, high in zip(starts.tolist(), np.append(starts[1:], len(span)).tolist(), strict=True):
        first, last = span[low].tolist()
        block = values[low:high] @ database.descriptors[first:last].astype(np.float32).T
        block = half_norm[low:high, None] + database.half_norm[first:last] - block
        begin, end = end, end + block.size
        squared[begin:end] = block.ravel()
    return 2 * squared
