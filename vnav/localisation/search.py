"""Active search: matches between a photo's features and the map's landmarks.

Source: Sattler, Leibe, Kobbelt, "Efficient & effective prioritized matching for large-scale
image-based localization", 2017; claim 4, 2.2 to 2.9.
"""

import numpy as np

from vnav.core.arrays import Floats, Rows
from vnav.localisation import covisibility
from vnav.localisation.database import LandmarkDatabase
from vnav.localisation.matches import Matches, no_matches
from vnav.localisation.query import Query
from vnav.localisation.words import nearest_apart

MAX_REPEATS = 4  # places that a feature may match in
BATCH = 1000  # features, or descriptors of landmarks, searched at once


def seeds(query: Query) -> Matches:
    """Matches from the photo to the map, features with the fewest candidates first.

    Ends when one place has enough matches (claim 4, 2.3 to 2.5, 2.9).
    """
    return _from_photo(np.arange(len(query.photo.features)), 1, query)


def repeated_matches(features: Rows, query: Query) -> Matches:
    """Matches of some features with every place that looks alike, up to `MAX_REPEATS` of them.

    What repeats itself in the map has its second-nearest in another place and finds no match in
    `seeds`; here a match has rivals only in its own place.
    """
    return _from_photo(features, MAX_REPEATS, query)


def _from_photo(features: Rows, repeats: int, query: Query) -> Matches:
    """2D-3D: for each feature its nearest landmark, or nearest few apart, by the ratio test."""
    photo, database, config = query.photo, query.database, query.config
    word = photo.paths[:, database.tree.clamped(config.level_2d_3d)]
    span = database.index.span[word]
    candidates = span[:, 1] - span[:, 0]
    queue = features[np.argsort(candidates[features], kind="stable")]
    queue = queue[candidates[queue] > 0]
    found, fullness = no_matches(), np.zeros(database.index.keyframes, np.intp)
    for first in range(0, len(queue), BATCH):
        chosen = queue[first : first + BATCH]
        rows, distances = nearest_apart(
            photo.features.descriptors[chosen],
            span[chosen],
            database.inverted_file,
            max(repeats, 2),
        )
        cost = distances / _rivals(rows, distances, database, everywhere=repeats == 1)
        which, rank = np.nonzero(cost < config.ratio_2d_3d)
        row = rows[which, rank]
        more = Matches(chosen[which], row, database.index.owner[row], cost[which, rank])
        found, fullness = found.joined(more), fullness + covisibility.fullness(more, database.index)
        if fullness.max(initial=0) >= config.enough_matches:
            break
    return found


def completed(found: Matches, query: Query) -> Matches:
    """The matches of a place, and those of the landmarks near them in space, back to the photo.

    Landmarks with the fewest candidates first, until there are enough (claim 4, 2.6 to 2.9).
    """
    photo, database, config = query.photo, query.database, query.config
    near = np.zeros(len(database.index.points_world), bool)
    near[database.index.neighbours[found.landmark]] = True
    near[found.landmark] = False
    rows = database.rows_of(np.flatnonzero(near))
    span = photo.span[database.words(rows, config.level_3d_2d)]
    candidates = span[:, 1] - span[:, 0]
    queue = np.argsort(candidates, kind="stable")
    queue = queue[candidates[queue] > 0]
    for first in range(0, len(queue), BATCH):
        if len(found) >= config.enough_matches:
            break
        chosen = queue[first : first + BATCH]
        row = rows[chosen]
        feature, distance = nearest_apart(
            database.index.descriptors[row], span[chosen], photo.database, 2
        )
        cost = distance[:, 0] / _expected(distance[:, 1], database)
        good = cost < config.ratio_3d_2d
        more = Matches(feature[good, 0], row[good], database.index.owner[row[good]], cost[good])
        found = found.joined(more).one_to_one()
    return found


def _rivals(
    rows: Rows, distances: Floats, database: LandmarkDatabase, *, everywhere: bool
) -> Floats:
    """Distance (N, K) of each candidate's nearest rival, of the same place or of everywhere."""
    home = database.home[database.index.owner[rows]]
    rival = database.index.covisible[home[:, :, None], home[:, None, :]] | everywhere
    rival &= ~np.eye(rows.shape[1], dtype=bool)
    return _expected(np.where(rival, distances[:, None, :], np.inf).min(2), database)


def _expected(second: Floats, database: LandmarkDatabase) -> Floats:
    """The second-nearest distance that the ratio test takes.

    A word may hide the second-nearest, and of a sole candidate it always does: it is never taken
    to be farther than where the map's landmarks typically have a distractor.
    """
    return np.asarray(
        np.maximum(np.minimum(second, database.index.distractor_distance), 1), np.float32
    )
