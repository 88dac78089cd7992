"""Covisibility clusters: sets of matches whose landmarks are seen together (hloc's term)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
    match, keyframe = index.near_keyframes_of(matches.landmark)
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
    _, keyframe = index.near_keyframes_of(matches.landmark)
    return np.bincount(keyframe, minlength=index.keyframes)
