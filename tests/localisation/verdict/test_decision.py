from dataclasses import replace

import numpy as np
import pytest

from vnav.config import LocateConfig
from vnav.core import se3
from vnav.core.camera import CameraPrior, Intrinsics
from vnav.localisation.hypotheses.pose_refinement import RefinedPose
from vnav.localisation.matches import Matches, no_matches
from vnav.localisation.photo import prepare
from vnav.localisation.pixels import Pixels
from vnav.localisation.prior import PlacePrior
from vnav.localisation.query import Query
from vnav.localisation.search.candidates import SearchResult
from vnav.localisation.verdict import decision
from vnav.localisation.verdict.decision import Located, NotLocated, decide
from vnav.localisation.verification.verify import VerifiedPose
from vnav.localisation.view import View

SEARCHED = SearchResult(no_matches(), 50, ())


@pytest.fixture
def query(world) -> Query:
    features, _ = world.seen(world.looking((0, 0, 1.4), 0), world.things, np.random.default_rng(0))
    photo = prepare(features, CameraPrior(world.camera), world.database.tree)
    return Query(photo, world.database, LocateConfig())


@pytest.fixture
def wide(query) -> Query:
    """The same of a map whose keyframes are in two places, at x = 0 and at x = 5."""
    index = query.database.index
    T = index.T_world_keyframe.copy()
    T[:, :3, 3] = (0.0, 0.0, 1.4)
    T[::2, 0, 3] = 5.0
    return replace(
        query, database=replace(query.database, index=replace(index, T_world_keyframe=T))
    )


def pose_at(query, x, found, matched=100) -> VerifiedPose:
    """A pose with so many of 20 predicted landmarks found in each of 48 cells."""
    landmarks = np.arange(matched)
    costs = np.zeros(matched, np.float32)
    matches = Matches(landmarks, landmarks, landmarks.astype(np.int32), costs)
    T_world_camera = se3.make(np.eye(3), (x, 0.0, 1.4))
    cells = np.stack([np.full(48, found), np.full(48, 20)])
    view = View(se3.inverse(T_world_camera), query.photo.intrinsics)
    return VerifiedPose(RefinedPose(view, 1e-6 * np.eye(6)), matches, cells)


def test_a_pose_that_the_map_bears_out_is_given(query):
    answer = decide([pose_at(query, 0.0, 9)], SEARCHED, query)
    assert isinstance(answer, Located)
    assert answer.confidence > 0.95


def test_the_stronger_of_two_poses_comes_first_whichever_was_found_first(query):
    weak, strong = pose_at(query, 0.0, 1), pose_at(query, 5.0, 9)
    for poses in ([weak, strong], [strong, weak]):
        assert decide(poses, SEARCHED, query).hypotheses == (strong, weak)


def test_poses_that_see_the_same_are_one_hypothesis(query):
    """2 m from a wall: 4 cm are 10.5 px by a focal length of 525, 6 cm are 16; 12 are the same."""
    index = query.database.index
    wall = np.tile(np.float32([0.0, 0.0, 1.4 + 2.0]), (len(index.points_world), 1))
    query = replace(
        query, database=replace(query.database, index=replace(index, points_world=wall))
    )
    for x, count in ((0.04, 1), (0.06, 2)):
        answer = decide([pose_at(query, 0.0, 9), pose_at(query, x, 9)], SEARCHED, query)
        assert len(answer.hypotheses) == count


def test_a_pose_is_as_uncertain_as_another_of_its_place_is_far(query):
    """20 cm apart, of the 25 cm that a place is wide, as in front of equal books."""
    poses = [pose_at(query, 0.0, 9), pose_at(query, 0.2, 9)]
    answer = decide(poses, SEARCHED, query)
    assert isinstance(answer, Located)
    assert answer.hypotheses == tuple(poses)
    assert answer.sigmas.position_m[0] == pytest.approx(0.2 * np.sqrt(0.5), rel=0.01)


def test_a_place_within_which_others_are_like_it_is_ambiguous(query):
    """Books to either side fit nearly as well: why not those of a shelf where nobody has been?"""
    cells = np.stack([np.where(np.arange(48) % 3, 9, 0), np.full(48, 20)])
    strongest = replace(pose_at(query, 0.0, 9), cells=cells)
    halves = np.stack([np.where(np.arange(48) % 8 < 5, 9, 0), np.full(48, 20)])
    beside = [replace(pose_at(query, x, 9, matched=40), cells=halves) for x in (-0.19, 0.19)]
    assert isinstance(decide([strongest], SEARCHED, query), Located)
    answer = decide([strongest, *beside], SEARCHED, query)
    assert isinstance(answer, NotLocated)
    assert answer.reason == "ambiguous"


def test_two_places_that_are_borne_out_alike_are_ambiguous(query):
    answer = decide([pose_at(query, 0.0, 9), pose_at(query, 0.3, 9)], SEARCHED, query)
    assert isinstance(answer, NotLocated)
    assert answer.reason == "ambiguous"
    np.testing.assert_allclose(answer.chances, 0.5, atol=1e-2)


def test_of_two_places_that_are_borne_out_alike_that_with_more_matches_is_likelier(query):
    """A rival explains what repeats itself, the right place the rest of the photo, too."""
    few, many = pose_at(query, 0.0, 9), pose_at(query, 5.0, 9, matched=200)
    answer = decide([few, many], SEARCHED, query)
    assert answer.hypotheses == (many, few)
    np.testing.assert_allclose(answer.chances, [0.8, 0.2], atol=0.01)


def test_a_place_that_others_are_like_is_ambiguous_though_no_other_is_as_likely(query):
    """Half of its landmarks are found in two other places: why not where nobody has been?"""
    cells = np.stack([np.where(np.arange(48) % 3, 9, 0), np.full(48, 20)])
    strongest = replace(pose_at(query, 0.0, 9), cells=cells)
    halves = np.stack([np.where(np.arange(48) % 8 < 5, 9, 0), np.full(48, 20)])
    rivals = [replace(pose_at(query, x, 9, matched=40), cells=halves) for x in (5.0, 10.0)]
    assert isinstance(decide([strongest], SEARCHED, query), Located)
    answer = decide([strongest, *rivals], SEARCHED, query)
    assert isinstance(answer, NotLocated)
    assert answer.reason == "ambiguous"


def before(x, **changes) -> PlacePrior:
    """The photo before was taken there, for sure."""
    centre = np.array([x, 0.0, 1.4])
    return replace(PlacePrior("before.jpg", centre, 1.0, step_m=1.0, told=98), **changes)


def test_the_photos_before_tell_which_of_two_like_places_it_is(wide):
    """Whichever has the stronger evidence, and it is told that they did."""
    for weak, strong in ((8, 9), (9, 9), (9, 8)):
        poses = [pose_at(wide, 0.0, weak), pose_at(wide, 5.0, strong)]
        held = decide(poses, SEARCHED, wide, before(0.5))
        assert isinstance(held, Located)
        assert held.best is poses[0]
        assert held.prior is not None


def test_what_is_borne_out_by_itself_does_not_need_the_photos_before(wide):
    """Though they were taken elsewhere."""
    answer = decide([pose_at(wide, 0.0, 9)], SEARCHED, wide, before(8.0))
    assert isinstance(answer, Located)
    assert answer.prior is None


def test_the_photos_before_do_not_hold_what_the_photo_does_not_show(wide):
    answer = decide([pose_at(wide, 0.0, 0)], SEARCHED, wide, before(0.0))
    assert isinstance(answer, NotLocated)


def test_the_photos_before_do_not_hold_a_pose_of_few_matches(wide):
    """Twice `locate.min_inliers` are 24: chance poses beside the right one have fewer."""
    for matches, given in ((23, False), (24, True)):
        poses = [
            replace(pose, matches=pose.matches[np.arange(matches)])
            for pose in (pose_at(wide, 0.0, 9), pose_at(wide, 5.0, 9))
        ]
        assert isinstance(decide(poses, SEARCHED, wide), NotLocated)
        assert isinstance(decide(poses, SEARCHED, wide, before(0.0)), Located) == given


def test_an_unsure_photo_before_does_not_decide_between_like_places(wide):
    """Its confidence of 0.6 leaves the other place 0.4."""
    poses = [pose_at(wide, 0.0, 9), pose_at(wide, 5.0, 9)]
    unsure = decide(poses, SEARCHED, wide, before(0.0, confidence=0.6))
    assert isinstance(unsure, NotLocated)
    assert unsure.reason == "ambiguous"


def test_a_place_that_shows_one_corner_of_the_photo_is_no_rival_of_one_that_shows_all(query):
    """Where the map predicts next to nothing, nothing speaks against a pose of a few matches."""
    whole = pose_at(query, 0.0, 9)
    cells = np.zeros((2, 48), np.intp)
    cells[:, :2] = [[9], [20]]
    corner = replace(pose_at(query, 5.0, 9), cells=cells, matches=whole.matches[np.arange(18)])
    answer = decide([whole, corner], SEARCHED, query)
    assert isinstance(answer, Located)
    assert answer.hypotheses == (whole,)


def test_a_pose_of_which_hardly_anything_is_found_is_not_given(query):
    answer = decide([pose_at(query, 0.0, 0)], SEARCHED, query)
    assert isinstance(answer, NotLocated)
    assert answer.reason == "no consistent pose"


@pytest.mark.parametrize(("votes", "reason"), [(11, "too few matches"), (12, "no consistent pose")])
def test_without_a_pose_the_reason_is_whether_matches_were_enough_for_one(query, votes, reason):
    """12 inliers make a pose: `locate.min_inliers`."""
    answer = decide([], SearchResult(no_matches(), votes, ()), query)
    assert isinstance(answer, NotLocated)
    assert answer.reason == reason


def pixels_that_say(monkeypatch, chances) -> Pixels:
    """Pixels by which two places have these probabilities."""
    monkeypatch.setattr(decision, "compared", lambda *_: np.array(chances))
    return Pixels(
        np.zeros((1, 1, 3), np.uint8),
        Intrinsics(1, 1, 1.0, 1.0, 0.0, 0.0),
        lambda _: pytest.fail("no keyframe is needed"),
    )


def test_pixels_tell_places_apart_that_are_borne_out_alike(query, monkeypatch):
    query = replace(query, pixels=pixels_that_say(monkeypatch, [0.01, 0.98]))
    first, second = pose_at(query, 0.0, 9), pose_at(query, 5.0, 9)
    answer = decide([first, second], SEARCHED, query)
    assert isinstance(answer, Located)
    assert answer.hypotheses == (second, first)
    assert answer.chances == (0.98, 0.01)


def test_a_photo_that_its_pixels_leave_open_is_ambiguous(query, monkeypatch):
    query = replace(query, pixels=pixels_that_say(monkeypatch, [0.2, 0.1]))
    answer = decide([pose_at(query, 0.0, 9), pose_at(query, 5.0, 9)], SEARCHED, query)
    assert isinstance(answer, NotLocated)
    assert answer.reason == "ambiguous"


def test_pixels_are_not_asked_where_features_tell(query, monkeypatch):
    """They take longer than all the rest."""
    query = replace(query, pixels=pixels_that_say(monkeypatch, [0.0, 0.0]))
    answer = decide([pose_at(query, 0.0, 9), pose_at(query, 5.0, 1)], SEARCHED, query)
    assert isinstance(answer, Located)
