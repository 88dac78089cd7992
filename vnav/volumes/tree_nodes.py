"""Voxels as the nodes of an octree and back, in the order in which OctoMap writes them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled

DEPTH = 16  # of OctoMap's trees: three bits of a voxel's code for each level
NODE = np.dtype([("log_odds", "<f4"), ("children", "u1")])


def tree_nodes(code: NDArray[np.int64], log_odds: NDArray[np.float32]) -> NDArray[Any]:
    """Nodes (N,) of type `NODE`, the root first and each before its children.

    ``code`` (V,): ascending Morton codes of the voxels, which are the leaves; ``log_odds`` (V,). An
    inner node has the largest log-odds of its children, and a bit for each of them.
    """
    new_level = _first_own_level(code)
    nodes = np.zeros((DEPTH + 1 - new_level).sum(), NODE)
    _fill(nodes["log_odds"], nodes["children"], code, log_odds, new_level)
    return nodes


def leaf_corners(nodes: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The lowest corner (L, 3), in voxels, and the level (L,) of the leaves among nodes (N,).

    ValueError where they are not the nodes of one tree.
    """
    corner = np.zeros((np.count_nonzero(nodes["children"] == 0), 3), np.int64)
    level = np.zeros(len(corner), np.int64)
    if len(nodes) and not _find_leaves(nodes["children"], corner, level):
        raise ValueError("not the nodes of a tree")
    return corner, level


@compiled
def _find_leaves(
    children: NDArray[np.uint8], corner: NDArray[np.int64], level: NDArray[np.int64]
) -> bool:
    """Fill corners and levels; False where the nodes are none of a tree."""
    waiting = np.zeros((8 * DEPTH + 1, 4), np.int64)  # corner and level of nodes that come next
    last, leaves = 0, 0
    for n in range(len(children)):
        if last < 0:
            return False
        x, y, z, depth = waiting[last]
        last -= 1
        if not children[n]:
            corner[leaves, 0], corner[leaves, 1], corner[leaves, 2] = x, y, z
            level[leaves] = depth
            leaves += 1
            continue
        if depth == DEPTH:
            return False
        edge = 1 << (DEPTH - depth - 1)
        for child in range(7, -1, -1):
            if children[n] >> child & 1:
                last += 1
                waiting[last, 0] = x + edge * (child & 1)
                waiting[last, 1] = y + edge * (child >> 1 & 1)
                waiting[last, 2] = z + edge * (child >> 2)
                waiting[last, 3] = depth + 1
    return last < 0


@compiled
def _first_own_level(code: NDArray[np.int64]) -> NDArray[np.int64]:
    """The first level, of 0 to 16, at which each voxel's node is not that of the voxel before."""
    level = np.zeros(len(code), np.int64)
    for n in range(1, len(code)):
        differ = code[n] ^ code[n - 1]
        level[n] = DEPTH
        while differ >> 3 * (DEPTH + 1 - level[n]):
            level[n] -= 1
    return level


@compiled
def _fill(
    value: NDArray[np.float32],
    children: NDArray[np.uint8],
    code: NDArray[np.int64],
    log_odds: NDArray[np.float32],
    new_level: NDArray[np.int64],
) -> None:
    path = np.zeros(DEPTH + 1, np.int64)  # the voxel's node at each level
    count = 0
    for n in range(len(code)):
        for level in range(new_level[n], DEPTH + 1):
            path[level] = count
            value[count] = log_odds[n]
            if level:
                children[path[level - 1]] |= 1 << (code[n] >> 3 * (DEPTH - level) & 7)
            count += 1
        for level in range(new_level[n]):
            value[path[level]] = max(value[path[level]], log_odds[n])
