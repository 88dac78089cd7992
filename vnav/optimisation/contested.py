"""Doubtful edges held against the rest of a graph: what agrees, and what nothing decides."""

from collections.abc import Sequence
from itertools import compress

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from vnav.core.arrays import Array
from vnav.core.frame import Edge
from vnav.core.graph import ends_of
from vnav.optimisation import pose_graph


def agreement(
    initial: Array, trusted: Sequence[Edge], doubtful: Sequence[Edge], max_sigmas: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which doubtful edges (E,) agree with trusted ones and each other, and which are contested.

    All others are wrong. One that agrees, but alone connects two components, has been tested by
    nothing: it stands against what was rejected between them, and all of these are contested.
    ``initial`` (N, 4, 4): poses to start from.
    """
    ends, first = ends_of([*trusted, *doubtful]), len(trusted)
    kept = _kept_nearby(initial, trusted, doubtful, max_sigmas)
    used = np.append(np.ones(first, bool), kept)
    to_test = (first + np.flatnonzero(kept)).tolist()
    bridges = [n for n in to_test if _is_bridge(n, ends, used, len(initial))]
    used[bridges] = False
    component = _components(len(initial), ends[used])
    contested = component[ends[first:, 0]] != component[ends[first:, 1]]
    return used[first:], contested


def _kept_nearby(
    initial: Array, trusted: Sequence[Edge], doubtful: Sequence[Edge], max_sigmas: float
) -> NDArray[np.bool_]:
    """Which doubtful edges agree with each other and the trusted ones around them.

    Data snooping (Baarda 1968): a least-squares fit without the edge that is farthest off, until
    none is more than ``max_sigmas`` off; one in each cluster of doubtful edges at a time.
    """
    near = np.zeros(len(initial), bool)
    near[ends_of(doubtful)] = True
    ends = ends_of(trusted)
    near[ends[near[ends].any(1)]] = True
    poses = np.where(near[:, None, None], initial, np.nan)
    around = [e for e in trusted if near[e.i] and near[e.j]]
    kept, ends = np.ones(len(doubtful), bool), ends_of(doubtful)
    while True:
        fitted = pose_graph.fit(poses, [*around, *compress(doubtful, kept)])
        sigmas = pose_graph.check_closures(fitted, doubtful, max_sigmas).closure_sigmas
        cluster = _components(len(poses), ends[kept])[ends[:, 0]]
        wrong = _worst(np.where(kept, sigmas, 0.0), max_sigmas, cluster)
        if not len(wrong):
            return np.asarray(sigmas <= max_sigmas)
        kept[wrong] = False


def _worst(sigmas: Array, max_sigmas: float, cluster: NDArray[np.int32]) -> NDArray[np.intp]:
    """The edge that is farthest off in each cluster (E,), where that is too far."""
    order = np.argsort(-sigmas, kind="stable")
    _, first = np.unique(cluster[order], return_index=True)
    worst = order[first]
    return np.asarray(worst[sigmas[worst] > max_sigmas])


def _is_bridge(n: int, ends: NDArray[np.intp], used: NDArray[np.bool_], count: int) -> bool:
    """Whether edge n alone connects its ends, of those used."""
    others = used.copy()
    others[n] = False
    component = _components(count, ends[others])
    return bool(component[ends[n, 0]] != component[ends[n, 1]])


def _components(count: int, ends: NDArray[np.intp]) -> NDArray[np.int32]:
    """Number (N,) of each frame's connected component by edges between rows (E, 2)."""
    graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], np.int32)
