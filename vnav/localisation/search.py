"""Active search: matches between a photo's features and the map's landmarks.

Source: Sattler, Leibe, Kobbelt, "Efficient & effective prioritized matching for large-scale
image-based localization", 2017; claim 4, 2.2 to 2.9.
"""

import numpy as np
from numpy.typing import NDArray

from vnav.config import LocateConfig
from vnav.localisation.atlas import Atlas
from vnav.localisation.matches import Matches, no_matches
from vnav.localisation.photo import Photo
from vnav.localisation.places import fullest
from vnav.localisation.words import nearest_two

Rows = NDArray[np.intp]

BATCH = 1000  # features, or descriptors of landmarks, searched at once


def seeds(photo: Photo, atlas: Atlas, config: LocateConfig) -> Matches:
    """Matches from the photo to the map, features with the fewest candidates first.

    Ends when one place has enough matches (claim 4, 2.3 to 2.5, 2.9).
    """
    word = photo.paths[:, atlas.tree.clamped(config.level_2d_3d)]
    span = atlas.index.span[word]
    candidates = span[:, 1] - span[:, 0]
    queue = np.argsort(candidates, kind="stable")
    queue = queue[candidates[queue] > 0]
    found = no_matches()
    for first in range(0, len(queue), BATCH):
        features = queue[first : first + BATCH]
        row, distance, rival = nearest_two(
            photo.features.descriptors[features], span[features], atlas.database
        )
        cost = _ratio(distance, rival, atlas)
        good = cost < config.ratio_2d_3d
        row = row[good]
        found += Matches(features[good], row, atlas.index.owner[row], cost[good])
        if fullest(found, atlas.index) >= config.enough_matches:
            break
    return found


def completed(found: Matches, photo: Photo, atlas: Atlas, config: LocateConfig) -> Matches:
    """The matches of a place, and those of the landmarks near them in space, back to the photo.

    Landmarks with the fewest candidates first, until there are enough (claim 4, 2.6 to 2.9).
    """
    near = np.setdiff1d(atlas.index.neighbours[found.landmark], found.landmark)
    rows = atlas.rows_of(near.astype(np.int32))
    span = photo.span[atlas.words(rows, config.level_3d_2d)]
    candidates = span[:, 1] - span[:, 0]
    queue = np.argsort(candidates, kind="stable")
    queue = queue[candidates[queue] > 0]
    for first in range(0, len(queue), BATCH):
        if len(found) >= config.enough_matches:
            break
        chosen = queue[first : first + BATCH]
        row = rows[chosen]
        feature, distance, rival = nearest_two(
            atlas.index.descriptors[row], span[chosen], photo.database
        )
        cost = _ratio(distance, rival, atlas)
        good = cost < config.ratio_3d_2d
        row = row[good]
        found += Matches(feature[good], row, atlas.index.owner[row], cost[good])
    return found


def _ratio(
    distance: NDArray[np.float32], rival: NDArray[np.float32], atlas: Atlas
) -> NDArray[np.float32]:
    """Nearest over second-nearest distance.

    A word may hide the second-nearest, and of a sole candidate it always does: the second-nearest
    is never taken to be farther than where the map's landmarks typically have a stranger.
    """
    return np.asarray(distance / np.maximum(np.minimum(rival, atlas.index.stranger), 1), np.float32)
