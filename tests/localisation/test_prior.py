"""What the photos before tell: how much likelier a place near them is, and how surely."""

import dataclasses

import numpy as np
import pytest

from vnav.core import se3
from vnav.localisation.prior import MOST_ODDS, PlacePrior
from vnav.localisation.view import View

SHARE = 0.3  # of the keyframes within reach
BEFORE = PlacePrior("before.jpg", np.zeros(3), confidence=1.0, step_m=2.0, told=98)


@pytest.fixture
def index(world):
    """Of a map with ten keyframes in a row, 1 m apart, the first of them at the prior."""
    T = np.array([se3.make(np.eye(3), (float(x), 0.0, 0.0)) for x in range(10)])
    rows = np.zeros(10, int)
    index = world.database.index
    return dataclasses.replace(
        index,
        T_world_keyframe=T,
        keyframe_covariance=index.keyframe_covariance[rows],
        covisible=np.eye(10, dtype=bool),
        sees_start=np.zeros(11, np.int32),
    )


def at(world, x):
    return View(se3.inverse(se3.make(np.eye(3), (x, 0.0, 0.0))), world.camera)


def test_a_place_within_reach_is_likelier_than_chance_by_the_share_of_the_map(world, index):
    """Three keyframes of ten are within 2 m: a chance pose is there with 30 %.

    One photo in a hundred is out of reach, as 70 % of all would be if the camera were anywhere.
    """
    near, far = BEFORE.odds([at(world, 1.9), at(world, 2.1)], index)
    anywhere = 0.01 / (1 - SHARE)
    assert near == pytest.approx((1 - anywhere) / SHARE + anywhere)
    assert far == pytest.approx(anywhere)


def test_in_a_large_map_the_odds_are_bounded(world, index):
    one_of_ten = dataclasses.replace(BEFORE, step_m=0.5)
    assert one_of_ten.odds([at(world, 0.1)], index) == MOST_ODDS


def test_where_all_of_the_map_is_within_reach_a_prior_says_nothing(world, index):
    everywhere = dataclasses.replace(BEFORE, step_m=20.0)
    np.testing.assert_allclose(everywhere.odds([at(world, 0), at(world, 9)], index), 1)


def test_what_is_not_sure_of_itself_says_less(world, index):
    unsure = dataclasses.replace(BEFORE, confidence=0.95)
    near, far = unsure.odds([at(world, 0), at(world, 9)], index)
    assert far == pytest.approx(0.01 / (1 - SHARE) + 0.05)
    assert near < BEFORE.odds([at(world, 0)], index)


def test_photos_have_to_show_that_they_are_a_sequence(world, index):
    """A single one before tells little; photos from anywhere, of which 70 % are far, nothing."""
    views = [at(world, 0), at(world, 9)]
    first = dataclasses.replace(BEFORE, told=0)
    near, far = first.odds(views, index)
    assert near / far < 5
    scattered = dataclasses.replace(BEFORE, told=98, jumped=69)
    np.testing.assert_allclose(scattered.odds(views, index), 1)


def test_what_a_photo_tells_of_the_sequence_it_tells_by_itself(world):
    """One that the prior holds would tell what the prior says."""
    far, near = at(world, 9), at(world, 1)
    later = BEFORE.after("next.jpg", far, 1.0, alone=True)
    assert (later.told, later.jumped) == (BEFORE.told + 1, 1)
    assert BEFORE.after("next.jpg", near, 1.0, alone=True).jumped == 0
    assert BEFORE.after("next.jpg", near, 1.0, alone=False).told == BEFORE.told


def test_each_photo_that_is_not_located_lets_the_camera_come_farther(world):
    lost = BEFORE.after_another().after_another()
    assert lost.reach_m == 6.0
    assert lost.after("next.jpg", at(world, 1), 0.99, alone=True).reach_m == 2.0
