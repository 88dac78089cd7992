"""Matches from a photo's features to landmarks, by words and the ratio test (claim 4, 2.3 to 2.5).

Source: Sattler, Leibe, Kobbelt, "Efficient & effective prioritized matching for large-scale
image-based localization", 2017.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Floats, Rows
from vnav.localisation.database import LandmarkDatabase
from vnav.localisation.inverted_file import nearest_distinct
from vnav.localisation.matches import Matches, no_matches
from vnav.localisation.query import Query
from vnav.localisation.search.covisibility import keyframe_votes

SMALLEST = 2.0**-9  # of the typical distance: a second-nearest that is no nearer
BATCH = 1000  # features, or descriptors of landmarks, searched at once


def match_2d_3d(features: Rows, count: int, query: Query) -> Matches:
    """Matches of some features with their nearest landmark each, or their ``count`` nearest.

    Features with the fewest candidates come first; it ends when one covisibility cluster has enough
    matches (claim 4, 2.9).
    """
    word = query.photo.paths[:, query.level_2d_3d]
    span = query.database.index.span[word]
    return until_enough(match_in_ranges(features, span[:, None], count, query), query)


def until_enough(found_in_turn: Iterator[Matches], query: Query) -> Matches:
    """Matches one lot after the other, until one covisibility cluster has enough."""
    index = query.database.index
    found, votes = no_matches(), np.zeros(index.keyframes, np.intp)
    for more in found_in_turn:
        found, votes = found.joined(more), votes + keyframe_votes(more, index)
        if votes.max(initial=0) >= query.config.enough_matches:
            break
    return found


def match_in_ranges(
    features: Rows, span: NDArray[np.int32], count: int, query: Query
) -> Iterator[Matches]:
    """Matches with the landmarks in ranges (N, R, 2) of the index' rows, ``BATCH`` features a time.

    Of one nearest, the second-nearest of the ratio test is sought in all ranges, of several
    (``count``) for each among the landmarks that are seen together with it.
    """
    photo, database, config = query.photo, query.database, query.config
    queue = fewest_first(features, (span[..., 1] - span[..., 0]).sum(1)[features])
    for first in range(0, len(queue), BATCH):
        chosen = queue[first : first + BATCH]
        rows, distances = nearest_distinct(
            photo.features.descriptors[chosen], span[chosen], database.inverted_file, max(count, 2)
        )
        second = _second_nearest(rows, distances, database, everywhere=count == 1)
        ratio = distances / bounded(second, database)
        which, rank = np.nonzero(ratio < config.ratio_2d_3d)
        row = rows[which, rank]
        yield Matches(chosen[which], row, database.index.owner[row], ratio[which, rank])


def fewest_first(rows: Rows, candidates: Rows) -> Rows:
    """The rows (N,) that have candidates, those with the fewest first."""
    order = np.argsort(candidates, kind="stable")
    return rows[order[candidates[order] > 0]]


def bounded(second: Floats, database: LandmarkDatabase) -> Floats:
    """The second-nearest distance that the ratio test takes.

    A word may hide the second-nearest, and of a sole candidate it always does: it is never taken
    to be farther than where the map's landmarks typically have a distractor.
    """
    least = SMALLEST * database.tree.space.typical
    return np.asarray(
        np.maximum(np.minimum(second, database.index.distractor_distance), least), np.float32
    )


def _second_nearest(
    rows: Rows, distances: Floats, database: LandmarkDatabase, *, everywhere: bool
) -> Floats:
    """Distance (N, K) of the nearest other candidate of each, covisible with it or everywhere."""
    other: NDArray[np.bool_] = ~np.eye(rows.shape[1], dtype=bool)
    if not everywhere:
        keyframe = database.reference_keyframe[database.index.owner[rows]]
        other = other & database.index.covisible[keyframe[:, :, None], keyframe[:, None, :]]
    return np.asarray(np.where(other, distances[:, None, :], np.inf).min(2), np.float32)
