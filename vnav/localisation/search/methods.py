"""How matches between photo and map are sought: in both directions, in one, or by the tree alone.

Claim 4 has both directions, and names direct tree search and one direction alone as possible.
"""

from collections.abc import Iterator
from typing import Protocol

import numpy as np

from vnav.config.registries import SEARCHES, registered
from vnav.localisation.matches import Matches, no_matches
from vnav.localisation.query import Query
from vnav.localisation.search.matches_2d_3d import BATCH, match_2d_3d, match_in_ranges, until_enough
from vnav.localisation.search.matches_3d_2d import match_3d_2d, match_rows

LEAVES = 16  # of the tree that are searched for one feature


class SearchMethod(Protocol):
    """Seeks matches of a photo in the whole map, then more in one place."""

    def matches(self, query: Query) -> Matches:
        """Matches of features with their nearest landmark each."""

    def completed(self, found: Matches, query: Query) -> Matches:
        """The matches of a covisibility cluster, and more that they lead to, one to one."""


def search_method(name: str) -> SearchMethod:
    """The method that the setting ``locate.search`` names."""
    made: SearchMethod = registered(SEARCHES, name)()
    return made


class CompoundSearch:
    """2D-3D in the whole map, then 3D-2D around each cluster (Sattler, Leibe, Kobbelt 2017)."""

    def matches(self, query: Query) -> Matches:
        """By words of the photo's features."""
        return match_2d_3d(query.all_features, 1, query)

    def completed(self, found: Matches, query: Query) -> Matches:
        """With the matches of the landmarks nearby."""
        return match_3d_2d(found, query)


class InterleavedSearch:
    """3D-2D around each 2D-3D match as it is found, before the next feature (claim 4, 2.3-2.9)."""

    def matches(self, query: Query) -> Matches:
        """Features with the fewest candidates first, until one cluster has enough matches."""
        span = query.database.index.span[query.photo.paths[:, query.level_2d_3d]]
        in_turn = match_in_ranges(query.all_features, span[:, None], 1, query)
        return until_enough(_with_those_around(in_turn, query), query)

    def completed(self, found: Matches, query: Query) -> Matches:
        """As they are: what is nearby has been searched."""
        return found


class SearchOf2d3d:
    """From the photo's features to the map alone (claim 4, 2.3 to 2.5)."""

    def matches(self, query: Query) -> Matches:
        """By words of the photo's features."""
        return match_2d_3d(query.all_features, 1, query)

    def completed(self, found: Matches, query: Query) -> Matches:
        """As they are."""
        return found


class SearchOf3d2d:
    """From the map's landmarks to the photo alone, those that most keyframes saw first.

    Source: Li, Snavely, Huttenlocher, "Location recognition using prioritized feature matching",
    2010.
    """

    def matches(self, query: Query) -> Matches:
        """Of each feature the landmark that matches it best."""
        found = until_enough(_of_most_seen(query), query)
        best_first = found[np.lexsort((found.cost, found.feature))]
        return best_first[np.unique(best_first.feature, return_index=True)[1]]

    def completed(self, found: Matches, query: Query) -> Matches:
        """With the matches of the landmarks nearby, which had not their turn yet."""
        return match_3d_2d(found, query)


class TreeSearch:
    """Nearest descriptors by the tree alone: in the leaves nearest to a feature, whatever its word.

    Source: greedy N-best paths of Schindler, Brown, Szeliski, "City-scale location recognition",
    2007.
    """

    def matches(self, query: Query) -> Matches:
        """By the descriptors in the leaves."""
        leaves = query.database.tree.nearest_leaves(query.photo.features.descriptors, LEAVES)
        span = query.database.index.span[leaves] * (leaves >= 0)[:, :, None]
        return until_enough(match_in_ranges(query.all_features, span, 1, query), query)

    def completed(self, found: Matches, query: Query) -> Matches:
        """As they are."""
        return found


def _with_those_around(in_turn: Iterator[Matches], query: Query) -> Iterator[Matches]:
    """Each match with those of the landmarks nearby; no landmark twice, nor a feature."""
    found = no_matches()
    for match in (lot[np.array([k])] for lot in in_turn for k in range(len(lot))):
        if match.feature[0] in found.feature:
            continue
        more = match_3d_2d(match, query)
        known = np.isin(more.landmark, found.landmark) | np.isin(more.feature, found.feature)
        found = found.joined(more[~known])
        yield more[~known]


def _of_most_seen(query: Query) -> Iterator[Matches]:
    """Matches of all landmarks, those that most keyframes saw first."""
    index = query.database.index
    order = np.argsort(-np.diff(index.seen_start), kind="stable")
    for first in range(0, len(order), BATCH):
        yield from match_rows(query.database.rows_of(order[first : first + BATCH]), query)
