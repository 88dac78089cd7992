"""Covisibility clusters: sets of matches whose landmarks are seen together (hloc's term)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Rows
from vnav.core.map_index import MapIndex
from vnav.localisation.matches import Matches


@dataclass(frozen=True)
class CovisibilityCluster:
    """A keyframe, and the matches with landmarks that are seen from it or from a covisible one."""

    keyframe: int
    matches: Matches


def covisibility_clusters(
    matches: Matches, index: MapIndex, count: int, min_votes: int
) -> list[CovisibilityCluster]:
    """At most ``count`` clusters with at least ``min_votes`` matches each, the fullest first.

    Each is the one with the most matches that no fuller one holds.
    """
    match, keyframe = near_keyframes(matches, index)
    free = np.ones(len(matches), bool)
    found: list[CovisibilityCluster] = []
    while len(found) < count and len(matches):
        votes = np.bincount(keyframe[free[match]], minlength=index.keyframes)
        most = int(votes.argmax())
        if votes[most] < min_votes:
            break
        here = match[keyframe == most]
        found.append(CovisibilityCluster(most, matches[here].one_to_one()))
        free[here] = False
    return found


def keyframe_votes(matches: Matches, index: MapIndex) -> NDArray[np.intp]:
    """How many matches the cluster of each keyframe (K,) holds."""
    return np.bincount(near_keyframes(matches, index)[1], minlength=index.keyframes)


def near_keyframes(matches: Matches, index: MapIndex) -> tuple[Rows, Rows]:
    """Each keyframe that sees a match's landmark or is covisible with one that does, once.

    The match (P,), ascending, and the keyframe (P,).
    """
    sees, beside = index.seen_start, index.covisible_start
    return _near(matches.landmark, sees, index.seen_by, beside, index.covisible_of)


@compiled
def _near(
    landmark: NDArray[np.int32],
    seen_start: NDArray[np.int32],
    seen_by: NDArray[np.int32],
    covisible_start: Rows,
    covisible_of: Rows,
) -> tuple[Rows, Rows]:
    """Counted first, then written down; ``last`` is the match that met a keyframe last."""
    keyframes = len(covisible_start) - 1
    match, keyframe = np.empty(0, np.intp), np.empty(0, np.intp)
    for writes in (False, True):
        last, count = np.full(keyframes, -1, np.intp), 0
        for n in range(len(landmark)):
            for seen in range(seen_start[landmark[n]], seen_start[landmark[n] + 1]):
                near = covisible_start[seen_by[seen]], covisible_start[seen_by[seen] + 1]
                for row in range(near[0], near[1]):
                    k = covisible_of[row]
                    if last[k] != n:
                        last[k] = n
                        if writes:
                            match[count], keyframe[count] = n, k
                        count += 1
        if not writes:
            match, keyframe = np.empty(count, np.intp), np.empty(count, np.intp)
    return match, keyframe
