import dataclasses

import numpy as np
import pytest

from vnav.config import LocateConfig
from vnav.core.camera import CameraPrior
from vnav.localisation.photo import prepare
from vnav.localisation.query import Query
from vnav.localisation.search.matches_2d_3d import match_2d_3d
from vnav.localisation.search.matches_3d_2d import match_3d_2d
from vnav.localisation.search.methods import search_method


@pytest.fixture
def query(world) -> Query:
    T = world.looking((0.4, -0.3, 1.5), 40.0)
    features, _ = world.seen(T, world.things, np.random.default_rng(5))
    photo = prepare(features, CameraPrior(world.camera), world.database.tree)
    return Query(photo, world.database, LocateConfig())


def found_by(name: str, query: Query, **settings):
    query = dataclasses.replace(query, config=dataclasses.replace(query.config, **settings))
    return search_method(name).matches(query)


def test_one_feature_leads_the_interleaved_search_to_what_is_around_its_landmark(query):
    """Before any other feature is asked."""
    first = match_2d_3d(query.all_features, 1, query)[np.arange(1)]
    around = match_3d_2d(first, query).feature
    found = found_by("interleaved", query).feature
    assert len(around) > 10
    assert np.array_equal(found[: len(around)], around)
    assert found[0] not in found[1:]


def test_the_interleaved_search_ends_when_there_are_enough(query):
    """Each match adds as many as its landmark has neighbours, all of one cluster."""
    few = found_by("interleaved", query, enough_matches=20)
    assert 20 <= len(few) < len(found_by("interleaved", query, enough_matches=1000))


def test_one_direction_alone_searches_at_its_own_level_only(query):
    """At the deepest level of 3D-2D few features share a landmark's word; 2D-3D does not mind."""
    deepest = query.database.tree.levels
    usual, deep = (found_by("2d3d", query, level_3d_2d=level) for level in (2, deepest))
    assert np.array_equal(usual.feature, deep.feature)
    usual, deep = (found_by("3d2d", query, level_2d_3d=level) for level in (1, deepest))
    assert np.array_equal(usual.feature, deep.feature)


def test_landmarks_that_many_keyframes_saw_come_first(query, monkeypatch):
    """With batches of one, the first enough matches are of landmarks seen by more keyframes."""
    monkeypatch.setattr("vnav.localisation.search.methods.BATCH", 50)
    found = found_by("3d2d", query, enough_matches=1)
    seen_by = np.diff(query.database.index.seen_start)
    assert seen_by[found.landmark].min() >= np.sort(seen_by)[-50]


def test_the_tree_finds_the_nearest_descriptor_of_the_map_more_often_than_words_do(query):
    features, database = query.photo.features, query.database
    values = features.descriptors.astype(np.float32)
    mapped = database.index.descriptors.astype(np.float32)
    nearest = ((mapped**2).sum(1) - 2 * values @ mapped.T).argmin(1)
    right = {}
    for name in ("tree", "2d3d"):
        found = found_by(name, query, ratio_2d_3d=1.0, enough_matches=100000)
        right[name] = (found.row == nearest[found.feature]).sum()
    assert right["tree"] > right["2d3d"]
