"""Keyframes that a bundle can do without: what they see, others see, too.

Source: Mur-Artal, Montiel, Tardos, "ORB-SLAM: a versatile and accurate monocular SLAM system",
2015, section VI-E.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

OTHERS = 3  # keyframes that a landmark needs beside
SHARE = 0.7  # of a keyframe's landmarks, those that it shares with any


def needed_keyframes(tracks: Sequence[NDArray[np.int32]], most: int) -> NDArray[np.intp]:
    """Numbers (S,) of the keyframes that a bundle needs, ascending: all, if they are no more.

    Of more than ``most``, those are left out, the least needed first, whose landmarks enough of
    the others see. So a place that is seen thirty times does not cost thirty times as much.
    ``tracks``: for each keyframe the number of each feature's track.
    """
    kept = np.ones(len(tracks), bool)
    if len(tracks) > most:
        count = np.bincount(np.concatenate(tracks))
        seen = [own[count[own] > 1] for own in tracks]
        for k in np.argsort([-_known(own, count) for own in seen], kind="stable").tolist():
            if kept.sum() <= most:
                break
            if _known(seen[k], count) >= SHARE:
                kept[k] = False
                count[seen[k]] -= 1
    return np.flatnonzero(kept)


def _known(own: NDArray[np.int32], count: NDArray[np.intp]) -> float:
    """Share of a keyframe's landmarks that enough others see, by how many see each."""
    return float((count[own] > OTHERS).mean()) if len(own) else 0.0
