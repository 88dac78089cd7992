"""Matches between features of several frames, merged into tracks of one 3D point each."""

import numpy as np
from numpy.typing import NDArray


def merge(matches: NDArray[np.int32], feature_counts: NDArray[np.int32]) -> NDArray[np.int32]:
    """Track number of every feature, numbered through over all frames.

    ``matches`` (M, 4) are frame, feature, frame, feature; ``feature_counts`` (K,) the features of
    each frame. Earlier matches win: a match that would put two features of one frame into the same
    track is left out. Features without a match get a track of their own.
    """
    starts = np.concatenate([[0], np.cumsum(feature_counts)])
    a = (starts[matches[:, 0]] + matches[:, 1]).tolist()
    b = (starts[matches[:, 2]] + matches[:, 3]).tolist()
    frame_of = np.repeat(np.arange(len(feature_counts)), feature_counts).tolist()
    parent = list(range(int(starts[-1])))
    frames: dict[int, set[int]] = {}

    def root(k: int) -> int:
        while parent[k] != k:
            parent[k] = k = parent[parent[k]]
        return k

    for i, j in zip(a, b, strict=True):
        i, j = root(i), root(j)
        if i == j:
            continue
        in_i = frames.get(i) or {frame_of[i]}
        in_j = frames.get(j) or {frame_of[j]}
        if in_i.isdisjoint(in_j):
            i, j = min(i, j), max(i, j)
            parent[j] = i
            frames[i] = in_i | in_j
            frames.pop(j, None)
    roots = np.array([root(k) for k in range(len(parent))], np.int64)
    return np.unique(roots, return_inverse=True)[1].astype(np.int32)
