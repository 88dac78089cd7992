"""Matches from landmarks near matched ones back to the photo: active search (claim 4, 2.6 to 2.9).

Source: Sattler, Leibe, Kobbelt, "Efficient & effective prioritized matching for large-scale
image-based localization", 2017.
"""

from collections.abc import Iterator

import numpy as np

from vnav.core.arrays import Rows
from vnav.localisation.database import LandmarkDatabase
from vnav.localisation.inverted_file import nearest_distinct
from vnav.localisation.matches import Matches
from vnav.localisation.query import Query
from vnav.localisation.search.matches_2d_3d import BATCH, bounded, fewest_first


def match_3d_2d(found: Matches, query: Query) -> Matches:
    """The matches found, and those of their landmarks' neighbours in space, one to one.

    Landmarks with the fewest candidates come first, until there are enough matches.
    """
    searched = match_rows(_neighbours(found, query.database), query)
    while len(found) < query.config.enough_matches and (more := next(searched, None)) is not None:
        found = found.joined(more).one_to_one()
    return found


def match_rows(rows: Rows, query: Query) -> Iterator[Matches]:
    """Matches of landmarks' descriptors (R,) with features of the photo, ``BATCH`` of them a time.

    Those with the fewest candidates come first; those without any are left out.
    """
    photo, database = query.photo, query.database
    span = photo.span[database.words(rows, query.level_3d_2d)]
    queue = fewest_first(np.arange(len(rows)), span[:, 1] - span[:, 0])
    for first in range(0, len(queue), BATCH):
        chosen = queue[first : first + BATCH]
        row = rows[chosen]
        feature, distance = nearest_distinct(
            database.index.descriptors[row], span[chosen], photo.inverted_file, 2
        )
        ratio = distance[:, 0] / bounded(distance[:, 1], database)
        good = ratio < query.config.ratio_3d_2d
        yield Matches(feature[good, 0], row[good], database.index.owner[row[good]], ratio[good])


def _neighbours(found: Matches, database: LandmarkDatabase) -> Rows:
    """Rows of the descriptors of the landmarks near matched ones, without those."""
    near = database.index.neighbours[found.landmark]
    first, last = (near.min(), near.max()) if near.size else (0, 0)
    is_new = np.zeros(last + 1 - first, bool)  # landmarks of one place have numbers close by
    is_new[near - first] = True
    is_new[found.landmark - first] = False
    return database.rows_of(first + np.flatnonzero(is_new))
