"""Keypoints spread over an image by a quadtree, so that one corner of it does not take them all.

Source: Mur-Artal, Montiel, Tardos, "ORB-SLAM: a versatile and accurate monocular SLAM system",
2015, section V-A.
"""

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Array, Floats, Rows

DEPTH = 12  # levels of the tree


def spread(
    px: Array | Floats, responses: Array | Floats, size: tuple[int, int], count: int
) -> Rows:
    """Rows of at most ``count`` keypoints (N, 2), the strongest of each leaf, strongest first.

    Nodes are split, the fullest first, until there are ``count`` leaves or each holds one
    keypoint. Ties go to the upper, then the left of them.
    """
    if not len(px):
        return np.zeros(0, np.intp)
    codes = _codes(px.astype(np.float64), float(max(size)))
    order = np.lexsort((px[:, 0], px[:, 1], -responses, codes))
    leaves = _leaves(codes[order], count)
    kept = order[_strongest(responses[order].astype(np.float64), leaves)]
    return kept[np.lexsort((px[kept, 0], px[kept, 1], -responses[kept]))][:count]


@compiled
def _codes(px: Array, edge_px: float) -> NDArray[np.int64]:
    """The path (N,) to each pixel from the root of a tree over a square: two bits a level."""
    codes, most = np.zeros(len(px), np.int64), 2**DEPTH - 1
    for n in range(len(px)):
        column = min(max(int(px[n, 0] * (2**DEPTH / edge_px)), 0), most)
        row = min(max(int(px[n, 1] * (2**DEPTH / edge_px)), 0), most)
        for bit in range(DEPTH):
            codes[n] |= (column >> bit & 1) << 2 * bit | (row >> bit & 1) << 2 * bit + 1
    return codes


@compiled
def _leaves(codes: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Where each leaf begins (L,) in the sorted paths."""
    begin = np.zeros(1, np.int64)
    for level in range(DEPTH):
        shift = 2 * (DEPTH - 1 - level)
        size = np.diff(np.append(begin, len(codes)))
        found = len(begin)
        if found >= count or size.max() < 2:
            break
        split = [begin[0] for _ in range(0)]
        for node in np.argsort(-size, kind="mergesort"):
            if found >= count or size[node] < 2:
                break
            first = begin[node]
            for row in range(first + 1, first + size[node]):
                if codes[row] >> shift != codes[row - 1] >> shift:
                    split.append(row)
                    found += 1
        begin = np.sort(np.append(begin, np.array(split, np.int64)))
    return begin


@compiled
def _strongest(responses: Array, leaves: NDArray[np.int64]) -> NDArray[np.int64]:
    """The strongest row (L,) of each leaf, the first of those alike."""
    kept = np.empty(len(leaves), np.int64)
    for leaf in range(len(leaves)):
        end = leaves[leaf + 1] if leaf + 1 < len(leaves) else len(responses)
        kept[leaf] = leaves[leaf] + responses[leaves[leaf] : end].argmax()
    return kept
