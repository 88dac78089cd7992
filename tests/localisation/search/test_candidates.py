import dataclasses

import numpy as np
import pytest

from vnav.config import LocateConfig
from vnav.core.camera import CameraPrior
from vnav.localisation.photo import prepare
from vnav.localisation.query import MIN_MATCHES, Query
from vnav.localisation.search.candidates import search, search_repeated
from vnav.localisation.search.matches_3d_2d import match_3d_2d


def query_of(world, position=(0.4, -0.3, 1.5), seed=5) -> Query:
    T = world.looking(position, 40.0)
    features, _ = world.seen(T, world.things, np.random.default_rng(seed))
    photo = prepare(features, CameraPrior(world.camera), world.database.tree)
    return Query(photo, world.database, LocateConfig())


def rooms_of(candidates, database) -> list[float]:
    """Which of the two rooms, 20 m apart, each candidate's landmarks lie in."""
    points = database.index.points_world
    return [float(np.median(points[c.matches.landmark, 0]) > 10) for c in candidates.candidates]


def test_the_fullest_candidate_is_where_the_photo_was_taken(world):
    query = query_of(world)
    first = search(query).candidates[0]
    seen_from = query.database.index.points_world[first.matches.landmark] - [0.4, -0.3, 1.5]
    heading = np.array([np.cos(np.deg2rad(40)), np.sin(np.deg2rad(40))])
    # The camera's half field of view is 31 degrees; few matches may be wrong.
    ahead = seen_from[:, :2] @ heading / np.linalg.norm(seen_from[:, :2], axis=1)
    assert (ahead > np.cos(np.deg2rad(31))).mean() > 0.9


def test_from_a_few_matches_their_landmarks_neighbours_are_found(world):
    query = query_of(world)
    few = search(query).candidates[0].seeds[np.arange(20)]
    found = match_3d_2d(few, query)
    assert len(found) > 2 * len(few)
    assert np.isin(few.landmark, found.landmark).mean() > 0.9


def test_enough_matches_are_not_added_to(world):
    query = query_of(world)
    few = search(query).candidates[0].seeds[np.arange(20)]
    satisfied = dataclasses.replace(query.config, enough_matches=20)
    assert match_3d_2d(few, dataclasses.replace(query, config=satisfied)) is few


def test_the_votes_are_the_most_matches_of_a_cluster(world):
    found = search(query_of(world))
    assert len(found.candidates[0].seeds) <= found.votes <= len(found.matches)


def test_what_two_rooms_have_in_common_is_found_in_both_only_when_repeats_are_asked_for(twin_world):
    query = query_of(twin_world)
    features = np.arange(len(query.photo.features))
    repeated = search_repeated(features, MIN_MATCHES, query)
    assert set(rooms_of(repeated, query.database)) == {0.0, 1.0}
    assert len(repeated.matches) > 2 * len(search(query).matches)


def test_only_the_features_asked_for_are_matched(world):
    query = query_of(world)
    features = np.arange(0, len(query.photo.features), 2)
    found = search_repeated(features, MIN_MATCHES, query)
    assert np.isin(found.matches.feature, features).all()


@pytest.mark.parametrize("few", [0, 1])
def test_no_features_have_no_candidates(world, few):
    query = query_of(world)
    found = search_repeated(np.arange(few), MIN_MATCHES, query)
    assert found.candidates == ()
    assert found.votes <= few
