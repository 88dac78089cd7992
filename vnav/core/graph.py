"""Walks over a graph of frames and the edges between them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import Edge
from vnav.core.mapping import LOST


def chain(
    count: int, edges: Sequence[Edge], roots: Sequence[int]
) -> tuple[Array, NDArray[np.int32]]:
    """Poses (N, 4, 4) and segments (N,) of frames from their edges, breadth first from the roots.

    Each segment starts at its first root; frames that no edge reaches are NaN and LOST.
    """
    joined = _joined(edges)
    poses = np.full((count, 4, 4), np.nan)
    segment = np.full(count, LOST, np.int32)
    for root in roots:
        if segment[root] == LOST:
            poses[root] = np.eye(4)
            segment[_fill(poses, joined, [root])] = segment.max() + 1
    return poses, segment


def reached(poses: Array, edges: Sequence[Edge]) -> Array:
    """Poses (N, 4, 4) with those filled in, NaN before, that edges reach from known ones."""
    poses = poses.copy()
    _fill(poses, _joined(edges), np.flatnonzero(np.isfinite(poses[:, 0, 0])).tolist())
    return poses


def _joined(edges: Sequence[Edge]) -> dict[int, list[tuple[int, Array]]]:
    """The frames that each frame has an edge to, and how these stand to it."""
    joined: dict[int, list[tuple[int, Array]]] = {}
    for e in edges:
        joined.setdefault(e.i, []).append((e.j, e.T_i_j))
        joined.setdefault(e.j, []).append((e.i, se3.inverse(e.T_i_j)))
    return joined


def _fill(
    poses: Array, joined: dict[int, list[tuple[int, Array]]], known: Sequence[int]
) -> list[int]:
    """Fill in poses that are NaN, breadth first from known ones; the rows of both."""
    rows = list(known)
    for i in rows:
        for j, T_i_j in joined.get(i, ()):
            if np.isnan(poses[j, 0, 0]):
                poses[j] = poses[i] @ T_i_j
                rows.append(j)
    return rows
