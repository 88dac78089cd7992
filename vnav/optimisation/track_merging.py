"""Matches between features of several frames, merged into tracks of one 3D point each."""

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled


def merge(matches: NDArray[np.int32], feature_counts: NDArray[np.int32]) -> NDArray[np.int32]:
    """Track number of every feature, numbered through over all frames.

    ``matches`` (M, 4) are frame, feature, frame, feature; ``feature_counts`` (K,) the features of
    each frame. Earlier matches win: a match that would put two features of one frame into the same
    track is left out. Features without a match get a track of their own.
    """
    starts = np.concatenate([[0], np.cumsum(feature_counts, dtype=np.int64)])
    frame_of = np.repeat(np.arange(len(feature_counts)), feature_counts)
    a, b = (
        (starts[frame] + feature).astype(np.int64, copy=False)
        for frame, feature in (matches.T[:2], matches.T[2:])
    )
    roots = _merged(a, b, frame_of, len(feature_counts))
    return np.unique(roots, return_inverse=True)[1].astype(np.int32)


@compiled
def _merged(
    a: NDArray[np.int64], b: NDArray[np.int64], frame_of: NDArray[np.int64], frames: int
) -> NDArray[np.int64]:
    """The first feature of each one's track, by pairs of features and by each one's frame."""
    parent = np.arange(len(frame_of))
    following = np.arange(len(frame_of))  # in its track, the first after the last
    size = np.ones(len(frame_of), np.int64)
    met = np.full(frames, -1)  # number of the pair at which a frame was met last
    for pair in range(len(a)):
        i, j = _root(parent, a[pair]), _root(parent, b[pair])
        if i == j or _share_a_frame(i, j, following, size, frame_of, met, pair):
            continue
        first, other = min(i, j), max(i, j)
        parent[other] = first
        size[first] += size[other]
        following[i], following[j] = following[j], following[i]
    for k in range(len(parent)):
        parent[k] = _root(parent, k)
    return parent


@compiled
def _root(parent: NDArray[np.int64], k: int) -> int:
    while parent[k] != k:
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k


@compiled
def _share_a_frame(
    i: int,
    j: int,
    following: NDArray[np.int64],
    size: NDArray[np.int64],
    frame_of: NDArray[np.int64],
    met: NDArray[np.int64],
    pair: int,
) -> bool:
    """Whether two tracks, by their first features, have features in one frame."""
    k = i
    for _ in range(size[i]):
        met[frame_of[k]] = pair
        k = following[k]
    k = j
    for _ in range(size[j]):
        if met[frame_of[k]] == pair:
            return True
        k = following[k]
    return False
