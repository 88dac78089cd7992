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
    seen = _seen_from(matches, index)
    free = np.ones(len(matches), bool)
    found: list[Place] = []
    while len(found) < count and len(matches):
        votes = (seen & free[:, None]).sum(0)
        keyframe = int(votes.argmax())
        if votes[keyframe] < least:
            break
        found.append(Place(keyframe, matches[seen[:, keyframe]].one_to_one()))
        free &= ~seen[:, keyframe]
    return found


def fullest(matches: Matches, index: MapIndex) -> int:
    """How many matches the fullest place holds."""
    return int(_seen_from(matches, index).sum(0).max(initial=0))


def _seen_from(matches: Matches, index: MapIndex) -> NDArray[np.bool_]:
    """Which matches (M, K) each keyframe, or one beside it, sees the landmark of."""
    seen = np.zeros((len(matches), index.keyframes), np.float32)
    seen[index.keyframes_of(matches.landmark)] = 1
    return np.asarray(seen @ index.beside.astype(np.float32) > 0)
