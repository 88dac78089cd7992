"""Relative poses of keyframes, which bundle adjustment keeps where landmarks are too few."""

from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import Edge
from vnav.core.graph import shortest_paths
from vnav.core.mapping import Odometry

CLOSED_SIGMAS = np.repeat([0.01, 0.03], 3)  # rad, m: between keyframes that loops close
PATH_NOISE_FACTOR = 2.0  # noise of a path over the sum of its edges': those of one frame err alike
Pair = tuple[int, int]


def keyframe_edges(poses: Array, odometry: Odometry, closed: set[Pair]) -> list[Edge]:
    """Edges between keyframes, by number: neighbours in odometry, and the pairs that loops closed.

    Neighbours have the motion and the noise of odometry's path between them, which saw the frames
    between, degenerate edges with them. The others, and those of given poses, have the motion of
    ``poses`` (N, 4, 4), those of all frames.
    """
    rows = odometry.keyframe_rows
    posed = np.isfinite(poses[rows, 0, 0])
    neighbours = _neighbours(odometry.segment[rows])
    edges = _of_poses(poses[rows], _both(posed, neighbours | closed))
    if not odometry.given:
        in_time = set(pairwise(range(len(rows))))
        edges |= _of_odometry(odometry, _both(posed, neighbours | in_time))
    return [edges[pair] for pair in sorted(edges)]


def by_number(edges: Iterable[Edge], rows: NDArray[np.intp]) -> list[Edge]:
    """Edges between rows of frames, between the keyframes (K,) of these rows; no others."""
    number = {row: k for k, row in enumerate(rows.tolist())}
    return [
        replace(e, i=number[e.i], j=number[e.j]) for e in edges if e.i in number and e.j in number
    ]


def _neighbours(segment: NDArray[np.int32]) -> set[Pair]:
    """Each keyframe and the next of its segment."""
    of_segment = [np.flatnonzero(segment == s).tolist() for s in np.unique(segment)]
    return {pair for keyframes in of_segment for pair in pairwise(keyframes)}


def _both(posed: NDArray[np.bool_], pairs: Iterable[Pair]) -> list[Pair]:
    """The pairs both of which have a pose."""
    return [(i, j) for i, j in pairs if posed[i] and posed[j]]


def _of_poses(T: Array, pairs: Iterable[Pair]) -> dict[Pair, Edge]:
    information = np.diag(CLOSED_SIGMAS**-2.0)
    return {(i, j): Edge(i, j, se3.inverse(T[i]) @ T[j], information) for i, j in pairs}


def _of_odometry(odometry: Odometry, pairs: Iterable[Pair]) -> dict[Pair, Edge]:
    """The pairs that a path of edges joins, with its motion and noise."""
    rows = odometry.keyframe_rows.tolist()
    number = {row: k for k, row in enumerate(rows)}
    edges = {}
    between = [(rows[i], rows[j]) for i, j in pairs]
    for path in shortest_paths(odometry.motions, between):
        i, j = number[path.i], number[path.j]
        edges[i, j] = Edge(i, j, path.T_i_j, path.information / PATH_NOISE_FACTOR**2)
    return edges
