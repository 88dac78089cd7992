"""Keyframes that a bundle can do without: what they see, others see, too.

Source: Mur-Artal, Montiel, Tardos, "ORB-SLAM: a versatile and accurate monocular SLAM system",
2015, section VI-E.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vnav.core.mapping import FrameFeatures
from vnav.core.tracks import merge

OTHERS = 5  # keyframes that a landmark needs beside; of fewer, the sensor's offset is lost
SHARE = 0.7  # of a keyframe's landmarks, those that it shares with any


def needed_keyframes(
    keyframes: Sequence[FrameFeatures], matches: NDArray[np.int32], most: int
) -> NDArray[np.intp]:
    """Numbers (S,) of the keyframes that a bundle needs, ascending: all, if they are no more.

    Of more than ``most``, those are left out, the least needed first, whose landmarks enough of
    the others see. So a place that is seen thirty times does not cost thirty times as much.
    ``matches`` (M, 4): keyframe, feature, keyframe, feature.
    """
    kept = np.ones(len(keyframes), bool)
    if len(keyframes) > most:
        seen = _shared_landmarks(keyframes, matches)
        count = np.bincount(np.concatenate(seen))
        for k in np.argsort([-_known(own, count) for own in seen], kind="stable").tolist():
            if kept.sum() <= most:
                break
            if _known(seen[k], count) >= SHARE:
                kept[k] = False
                count[seen[k]] -= 1
    return np.flatnonzero(kept)


def _shared_landmarks(
    keyframes: Sequence[FrameFeatures], matches: NDArray[np.int32]
) -> list[NDArray[np.int32]]:
    """For each keyframe the landmarks that it sees and that another one sees, too."""
    counts = np.array([len(k.features) for k in keyframes], np.int32)
    landmark = merge(matches, counts)
    is_shared = np.bincount(landmark)[landmark] > 1
    ends = np.cumsum(counts)
    of_keyframes = zip(np.split(landmark, ends[:-1]), np.split(is_shared, ends[:-1]), strict=True)
    return [own[shared] for own, shared in of_keyframes]


def _known(own: NDArray[np.int32], count: NDArray[np.intp]) -> float:
    """Share of a keyframe's landmarks that enough others see, by how many see each."""
    return float((count[own] > OTHERS).mean()) if len(own) else 0.0
