"""The first room of locating: parts of the map that match a photo (claim 4, 2.3 to 2.9)."""

from collections.abc import Callable
from dataclasses import dataclass

from vnav.core.arrays import Rows
from vnav.localisation.matches import Matches
from vnav.localisation.query import MIN_MATCHES, Query
from vnav.localisation.search.covisibility import covisibility_clusters, keyframe_votes
from vnav.localisation.search.matches_2d_3d import match_2d_3d
from vnav.localisation.search.matches_3d_2d import match_3d_2d
from vnav.localisation.search.methods import search_method

MAX_REPEATS = 4  # places that a feature may match in


@dataclass(frozen=True)
class Candidate:
    """A covisibility cluster of matches, and the same with more that these lead to."""

    seeds: Matches
    matches: Matches


@dataclass(frozen=True)
class SearchResult:
    """All matches in the map, the most that one covisibility cluster holds, and the candidates."""

    matches: Matches
    votes: int
    candidates: tuple[Candidate, ...]


def search(query: Query) -> SearchResult:
    """Where the photo's features match best: each with its nearest landmark, where it is clear."""
    method = search_method(query.config.search)
    return _search_result(method.matches(query), MIN_MATCHES, method.completed, query)


def search_repeated(features: Rows, min_votes: int, query: Query) -> SearchResult:
    """Where some features match in any place, up to `MAX_REPEATS` of them.

    What repeats itself in the map has its second-nearest in another place and finds no match in
    `search`; here a match has rivals only in its own place. Both directions are searched by any
    method: one that ends in the first place that matches would find no rival of it.
    """
    matches = match_2d_3d(features, MAX_REPEATS, query)
    return _search_result(matches, min_votes, match_3d_2d, query)


def _search_result(
    matches: Matches, min_votes: int, completed: Callable[[Matches, Query], Matches], query: Query
) -> SearchResult:
    index, count = query.database.index, query.config.max_clusters
    clusters = covisibility_clusters(matches, index, count, min_votes)
    candidates = [Candidate(c.matches, completed(c.matches, query)) for c in clusters]
    votes = int(keyframe_votes(matches, index).max(initial=0))
    return SearchResult(matches, votes, tuple(candidates))
