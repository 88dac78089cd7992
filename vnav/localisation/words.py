"""Nearest descriptors among those that share a word."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]
Rows = NDArray[np.intp]

PAIRS = 16000  # of query and candidate whose descriptors stay in the cache
SHARED = 3  # queries of one range, on average, that are compared in one product
LONGER = 1.5  # a range than the shortest of its part, at most, and by one


@dataclass(frozen=True)
class Database:
    """Descriptors (D, 128), bytes, in the order of the tree's leaves, and where each lies.

    Two descriptors whose ``position`` (D, k) differs by less than ``apart`` in every coordinate
    may be of the same thing: one is no rival of the other. ``half_norm`` (D,): half the squared
    length of each.
    """

    descriptors: NDArray[np.uint8] | Floats
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
    rows = np.zeros((len(queries), count), np.intp)
    squared = np.zeros((len(queries), count), np.float32)
    for part in _parts(span):
        rows[part], squared[part] = _nearest_apart(queries[part], span[part], database, count)
    return rows, np.sqrt(squared)


def _parts(span: NDArray[np.int32]) -> Iterator[Rows]:
    """The ranges in parts of about the same length, small enough for the processor's cache."""
    length = span[:, 1] - span[:, 0]
    order = np.lexsort((span[:, 0], length))
    ascending, first = length[order], 0
    while first < len(order):
        longest = int(LONGER * ascending[first]) + 1
        alike = int(ascending.searchsorted(longest, "right"))
        last = min(alike, first + max(1, PAIRS // longest))
        yield order[first:last]
        first = last


def _nearest_apart(
    queries: NDArray[np.uint8], span: NDArray[np.int32], database: Database, count: int
) -> tuple[Rows, Floats]:
    """The same for ranges of about the same length, with squared distances."""
    length = span[:, 1] - span[:, 0]
    slot = np.arange(length.max())
    row = span[:, :1] + np.minimum(slot, length[:, None] - 1)  # short ranges repeat their last
    half = _half_distances(queries, span, row, database)
    half[slot >= length[:, None]] = np.inf
    nearest = np.zeros((count, len(row)), np.intp)
    least = np.zeros((count, len(row)), np.float32)
    for k in range(count):
        left = np.arange(len(row))
        while len(left):
            at = half[left].argmin(1)
            nearest[k, left], least[k, left] = row[left, at], half[left, at]
            half[left, at] = np.inf
            left = left[_beside(nearest[:, left], k, database) & np.isfinite(least[k, left])]
    return nearest.T, 2 * (least.T + half_norms(queries)[:, None])


def _beside(nearest: Rows, k: int, database: Database) -> NDArray[np.bool_]:
    """Where the k-th of the rows (count, Q) may be of the same thing as one before it."""
    found = np.zeros(nearest.shape[1], bool)
    for before in nearest[:k]:
        offset = np.abs(database.position[nearest[k]] - database.position[before])
        found |= offset.max(1) < database.apart
    return found


def _half_distances(
    queries: NDArray[np.uint8], span: NDArray[np.int32], row: Rows, database: Database
) -> Floats:
    """Half the squared distances (Q, n) to rows (Q, n), but for half the query's squared length.

    Exact in float32: sums of products of bytes stay below 2^24. Where queries, sorted by their
    range, share it, they share a product.
    """
    values, described = queries.astype(np.float32), database.descriptors
    first = np.flatnonzero(np.append(True, span[1:, 0] != span[:-1, 0]))
    if SHARED * len(first) > len(span):
        candidates = described.take(row, 0).astype(np.float32, copy=False)
        product = np.matmul(candidates, values[:, :, None])[:, :, 0]
    else:
        product = np.zeros(row.shape, np.float32)
        last = np.append(first[1:], len(span))
        for low, high, (begin, end) in zip(first, last, span[first].tolist(), strict=True):
            candidates = described[begin:end].astype(np.float32, copy=False)
            product[low:high, : end - begin] = values[low:high] @ candidates.T
    return np.asarray(database.half_norm.take(row) - product)
