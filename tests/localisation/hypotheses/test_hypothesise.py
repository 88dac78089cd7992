import numpy as np
import pytest

from vnav.config import LocateConfig
from vnav.core import se3
from vnav.core.camera import CameraPrior
from vnav.localisation.hypotheses.hypothesise import hypothesise
from vnav.localisation.hypotheses.ransac import PoseHypothesis
from vnav.localisation.photo import prepare
from vnav.localisation.query import MIN_MATCHES, Query
from vnav.localisation.search.candidates import search, search_repeated
from vnav.localisation.view import View

POSITION = (0.4, -0.3, 1.5)


def query_of(world) -> Query:
    features, _ = world.seen(world.looking(POSITION, 40.0), world.things, np.random.default_rng(5))
    photo = prepare(features, CameraPrior(world.camera), world.database.tree)
    return Query(photo, world.database, LocateConfig())


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def test_the_true_pose_is_a_hypothesis(world, rng):
    query = query_of(world)
    found = hypothesise(search(query).candidates, [], query, rng)
    off_m = [np.linalg.norm(view.centre_world - POSITION) for view in found]
    # Some 100 inliers of 0.5 px at 525 px and 3 m: a few millimetres, with the landmarks' own.
    assert min(off_m) < 0.02


def test_each_of_two_rooms_that_look_the_same_has_a_pose_of_its_own(twin_world, rng):
    query = query_of(twin_world)
    features = np.arange(len(query.photo.features))
    repeated = search_repeated(features, MIN_MATCHES, query)
    found = hypothesise(repeated.candidates, [], query, rng)
    for x in (0.4, 20.4):
        off_m = [np.linalg.norm(view.centre_world - (x, *POSITION[1:])) for view in found]
        assert min(off_m) < 0.05


def test_what_a_known_pose_explains_is_no_second_hypothesis(world, rng):
    query = query_of(world)
    candidates = search(query).candidates[:1]
    view = View(se3.inverse(world.looking(POSITION, 40.0)), world.camera)
    known = PoseHypothesis(view, np.ones(100, bool))
    assert hypothesise(candidates, [], query, rng)
    assert hypothesise(candidates, [known], query, rng) == []


def test_no_candidates_have_no_hypotheses(world, rng):
    assert hypothesise([], [], query_of(world), rng) == []
