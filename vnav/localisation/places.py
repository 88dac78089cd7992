"""Sets of matches whose landmarks are seen together: the places a photo may have been taken at."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.core.map_index import MapIndex
from vnav.localisation.matches import Matches


@dataclass(frozen=True)
class Place:
    """A keyframe, and the matches with landmarks that are seen from it or beside it."""

    keyframe: int
    matches: Matches


def places(matches: Matches, index: MapIndex, count: int, least: int) -> list[Place]:
    """At most ``count`` places with at least ``least`` matches each, the fullest first.

    Each place is the one with the most matches that no fuller place holds.
    """
    match, keyframe = index.near_keyframes_of(matches.landmark)
    free = np.ones(len(matches), bool)
    found: list[Place] = []
    while len(found) < count and len(matches):
        votes = np.bincount(keyframe[free[match]], minlength=index.keyframes)
        most = int(votes.argmax())
        if votes[most] < least:
            break
        here = match[keyframe == most]
        found.append(Place(most, matches[here].one_to_one()))
        free[here] = False
    return found


def fullness(matches: Matches, index: MapIndex) -> NDArray[np.intp]:
    """How many matches the place of each keyframe (K,) holds."""
    _, keyframe = index.near_keyframes_of(matches.landmark)
    return np.bincount(keyframe, minlength=index.keyframes)
