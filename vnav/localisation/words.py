"""Nearest and second-nearest descriptors among those that share a word."""

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


def nearest_two(
    queries: NDArray[np.uint8], span: NDArray[np.int32], database: Database
) -> tuple[Rows, Floats, Floats]:
    """Nearest row of the database in each query's range of rows, its distance, and a rival's.

    ``queries`` (Q, 128), ``span`` (Q, 2), none empty. The rival is the nearest that lies
    elsewhere, inf where there is none. Linear search, as in claim 4, 2.4.
    """
    order = np.argsort(span[:, 0], kind="stable")
    best, squared, rival = _nearest_two(queries[order], span[order], database)
    back = np.argsort(order)
    return best[back], np.sqrt(squared[back]), np.sqrt(rival[back])


def _nearest_two(
    queries: NDArray[np.uint8], span: NDArray[np.int32], database: Database
) -> tuple[Rows, Floats, Floats]:
    """The same for queries in order of their range, with squared distances."""
    source, row = ranges(span[:, 0], span[:, 1])
    squared = _squared_distances(queries, span, database, len(row))
    first = np.append(0, np.cumsum(span[:, 1] - span[:, 0])[:-1])
    least = np.minimum.reduceat(squared, first)
    at = np.flatnonzero(squared == least[source])
    best = row[at[np.append(True, source[at][1:] != source[at][:-1])]]
    elsewhere = np.zeros(len(row), bool)
    for x in database.position.T:
        elsewhere |= np.abs(x[row] - x[best][source]) >= database.apart
    squared[~elsewhere] = np.inf
    return best, least, np.minimum.reduceat(squared, first)


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
