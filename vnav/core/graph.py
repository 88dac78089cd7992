"""Walks over a graph of frames and the edges between them: poses, components, shortest paths."""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import Edge
from vnav.core.mapping import LOST

SURE = 0.99  # the most that an edge's probability counts for


def ends_of(edges: Sequence[Edge]) -> NDArray[np.intp]:
    """The frames (E, 2) that edges join; E = 0 is legal."""
    return np.array([(e.i, e.j) for e in edges], np.intp).reshape(-1, 2)


def off_edges(poses: Array, edges: Sequence[Edge]) -> Array:
    """By how much (E, 4, 4) poses (N, 4, 4) are off the motions of edges; E = 0 is legal."""
    i, j = ends_of(edges).T
    T_i_j = np.array([e.T_i_j for e in edges]).reshape(-1, 4, 4)
    return np.asarray(se3.inverse(T_i_j) @ se3.inverse(poses[i]) @ poses[j])


def best_into(edges: Iterable[Edge]) -> dict[int, float]:
    """By frame that edges lead to: the probability of the most likely of them."""
    best: dict[int, float] = {}
    for e in edges:
        best[e.j] = max(best.get(e.j, 0.0), e.probability)
    return best


def weakest(edges: Iterable[Edge], i: int, j: int) -> tuple[int, float]:
    """Of the frames after row i to j: the one that edges within most likely got wrong.

    Its row, and the probability of the likeliest edge into it; of equals the last. Row j and 0.5
    without an edge.
    """
    into = best_into(e for e in edges if i <= e.i and e.j <= j)
    return min(into.items(), key=lambda item: (item[1], -item[0]), default=(j, 0.5))


def log_odds_of(probability: float) -> float:
    """That an edge is right; one that is sure counts for as much as what is just clear."""
    p = min(max(probability, 1 - SURE), SURE)
    return float(np.log(p / (1 - p)))


def chain(
    count: int, edges: Sequence[Edge], roots: Sequence[int]
) -> tuple[Array, NDArray[np.int32]]:
    """Poses (N, 4, 4) and segments (N,) of frames from their edges, breadth first from the roots.

    Each segment starts at its first root; frames that no edge reaches are NaN and LOST.
    """
    neighbours = _neighbours(edges)
    poses = np.full((count, 4, 4), np.nan)
    segment = np.full(count, LOST, np.int32)
    for root in roots:
        if segment[root] == LOST:
            poses[root] = np.eye(4)
            segment[_fill(poses, neighbours, [root])] = segment.max() + 1
    return poses, segment


def propagate_poses(poses: Array, edges: Sequence[Edge]) -> Array:
    """Poses (N, 4, 4) with those filled in, NaN before, that edges reach from known ones."""
    poses = poses.copy()
    _fill(poses, _neighbours(edges), np.flatnonzero(np.isfinite(poses[:, 0, 0])).tolist())
    return poses


def component_roots(nodes: NDArray[np.intp], edges: Sequence[Edge]) -> list[int]:
    """The first node of each connected component, ascending; edges are between these nodes."""
    parent = {int(n): int(n) for n in nodes}

    def root(n: int) -> int:
        while parent[n] != n:
            parent[n] = n = parent[parent[n]]
        return n

    for e in edges:
        a, b = sorted((root(e.i), root(e.j)))
        parent[b] = a
    return sorted({root(int(n)) for n in nodes})


def shortest_paths(
    edges: Sequence[Edge], pairs: Sequence[tuple[int, int]], most: Sequence[float] | None = None
) -> list[Edge]:
    """For each pair (i, j), i < j, the edge composed along the path with the least variance.

    Paths go forward, from a frame to a later one. A pair that no path joins is left out, and one
    whose path has a total variance beyond the ``most`` for it. Covariances add up as if the errors
    of edges were independent.
    """
    into: dict[int, list[Edge]] = {}
    reach: dict[int, int] = {}
    for e in edges:
        into.setdefault(e.j, []).append(e)
        reach[e.i] = max(e.j, reach.get(e.i, e.j))
    limits = [np.inf] * len(pairs) if most is None else most
    paths = [
        (*ij, _shortest_path(into, reach, *ij, limit))
        for ij, limit in zip(pairs, limits, strict=True)
    ]
    return [Edge(i, j, p[0], np.asarray(np.linalg.inv(p[1]))) for i, j, p in paths if p is not None]


def _shortest_path(
    into: dict[int, list[Edge]], reach: dict[int, int], first: int, last: int, most: float
) -> tuple[Array, Array] | None:
    """Motion and covariance (6, 6) from a frame to a later one, None where no path joins them.

    ``reach``: the last frame that edges lead to from each; beyond that of all on the way is none.
    """
    paths, end = {first: (np.eye(4), np.zeros((6, 6)))}, reach.get(first, first)
    for row in range(first + 1, last + 1):
        if row > end:
            return None
        found = [_composed(*paths[e.i], e) for e in into.get(row, ()) if e.i in paths]
        shortest = min(found, key=lambda path: float(np.trace(path[1])), default=None)
        if shortest is not None and np.trace(shortest[1]) <= most:
            paths[row], end = shortest, max(end, reach.get(row, row))
    return paths.get(last)


def _composed(T: Array, covariance: Array, e: Edge) -> tuple[Array, Array]:
    """A motion and its covariance, followed by an edge."""
    adjoint = se3.adjoint(se3.inverse(e.T_i_j))
    return T @ e.T_i_j, adjoint @ covariance @ adjoint.T + np.linalg.inv(e.information)


def _neighbours(edges: Sequence[Edge]) -> dict[int, list[tuple[int, Array]]]:
    """For each frame, the frames it has an edge to and their relative poses."""
    found: dict[int, list[tuple[int, Array]]] = {}
    for e in edges:
        found.setdefault(e.i, []).append((e.j, e.T_i_j))
        found.setdefault(e.j, []).append((e.i, se3.inverse(e.T_i_j)))
    return found


def _fill(
    poses: Array, neighbours: dict[int, list[tuple[int, Array]]], known: Sequence[int]
) -> list[int]:
    """Fill in poses that are NaN, breadth first from known ones; the rows of both."""
    rows = list(known)
    for i in rows:
        for j, T_i_j in neighbours.get(i, ()):
            if np.isnan(poses[j, 0, 0]):
                poses[j] = poses[i] @ T_i_j
                rows.append(j)
    return rows
