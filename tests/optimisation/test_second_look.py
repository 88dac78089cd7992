"""A second look at neighbouring keyframes of the tiny capture, whose odometry is right to mm.

What is wrong is 0.2 m off, a hundred times as far.
"""

import dataclasses
from functools import partial

import numpy as np
import pytest

from vnav.config import Config
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.frame import Edge
from vnav.core.mapping import Odometry
from vnav.io.store.artifacts import load_keyframe
from vnav.io.store.map_folder import MapFolder
from vnav.optimisation.contradictions import Contradiction
from vnav.optimisation.cycles import are_wrong
from vnav.optimisation.second_look import SecondLook
from vnav.registration.judge import CLEAR

FORTY = 40  # closures: many, for they are not to count here
SHIFT = se3.make(np.eye(3), [0.1, -0.17, 0.03])


@pytest.fixture(scope="module")
def look(odometry: Odometry, folder: MapFolder, camera: Intrinsics) -> SecondLook:
    return SecondLook(
        odometry, [camera], partial(load_keyframe, folder, frames=odometry.frames), Config()
    )


@pytest.fixture(scope="module", params=[0, 3])
def right(request: pytest.FixtureRequest, odometry: Odometry) -> Contradiction:
    """Closures that are right, across some stretch."""
    i, j = odometry.keyframe_rows[request.param : request.param + 2].tolist()
    T = odometry.T_segment_camera
    return Contradiction(i, j, se3.inverse(T[i]) @ T[j], FORTY)


def test_a_wrong_motion_is_replaced_by_the_one_that_closures_and_pixels_bear_out(
    look: SecondLook, right: Contradiction
) -> None:
    # Closures far away imply the motion to some centimetres only.
    about = se3.exp([0.01, -0.01, 0.02, 0.03, 0.02, -0.03])
    stretch = dataclasses.replace(right, T_i_j=right.T_i_j @ about)
    found = look.correct(stretch, right.T_i_j @ SHIFT)
    assert found is not None
    assert found.edge is not None
    assert (found.edge.i, found.edge.j) == (right.i, right.j)
    assert not are_wrong(se3.inverse(right.T_i_j) @ found.edge.T_i_j)


def test_a_right_motion_stays_however_many_closures_contradict_it(
    look: SecondLook, right: Contradiction
) -> None:
    for wrong in (SHIFT, se3.make(np.eye(3), [3.0, 0, 1.0])):
        stretch = dataclasses.replace(right, T_i_j=right.T_i_j @ wrong)
        assert look.correct(stretch, right.T_i_j) is None


def test_a_right_motion_stays_against_an_alternative_that_pixels_do_not_bear_out(
    odometry: Odometry, folder: MapFolder, camera: Intrinsics, right: Contradiction
) -> None:
    wrong = Edge(right.i, right.j, right.T_i_j @ SHIFT, np.eye(6))
    tempted = dataclasses.replace(odometry, alternatives=(wrong,))
    views = partial(load_keyframe, folder, frames=odometry.frames)
    look = SecondLook(tempted, [camera], views, Config())
    assert look.correct(dataclasses.replace(right, T_i_j=wrong.T_i_j), right.T_i_j) is None


def test_the_right_motion_is_clear_of_a_wrong_one_and_of_none(
    look: SecondLook, right: Contradiction
) -> None:
    log_odds = look.log_odds(right.i, right.j, [right.T_i_j, right.T_i_j @ SHIFT])
    assert (log_odds[0, 1:] > CLEAR).all()


def as_likely(odometry: Odometry, probability: float) -> Odometry:
    """The same, with edges that are as likely to be right."""
    edges = tuple(dataclasses.replace(e, probability=probability) for e in odometry.edges)
    return dataclasses.replace(odometry, edges=edges)


@pytest.mark.parametrize(("probability", "stays"), [(0.99, True), (0.5, False)])
def test_where_keyframes_nearly_tell_the_frames_between_decide(
    odometry: Odometry,
    look: SecondLook,
    right: Contradiction,
    probability: float,
    stays: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    wrong = Edge(right.i, right.j, right.T_i_j @ SHIFT, np.eye(6))
    tempted = dataclasses.replace(as_likely(odometry, probability), alternatives=(wrong,))
    monkeypatch.setattr(look, "_odometry", tempted)
    nearly = np.array([[0.0, 1.0, 50.0], [-1.0, 0.0, 49.0], [-50.0, -49.0, 0.0]])
    monkeypatch.setattr(look, "log_odds", lambda *_: nearly)
    found = look.correct(dataclasses.replace(right, T_i_j=wrong.T_i_j), right.T_i_j)
    assert (found is None) == stays
    assert stays or found.edge is None


@pytest.mark.parametrize(("probability", "stays"), [(0.6, True), (0.4, False)])
def test_a_motion_that_odometry_itself_doubts_is_cut_where_closures_contradict_it(
    odometry: Odometry,
    look: SecondLook,
    right: Contradiction,
    probability: float,
    stays: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(look, "_odometry", as_likely(odometry, probability))
    monkeypatch.setattr(look, "_other_motion", lambda _: None)  # a thing fills the keyframes
    found = look.correct(right, right.T_i_j @ SHIFT)
    assert (found is None) == stays
    assert stays or found.edge is None


@pytest.mark.parametrize(("leap_m", "stays"), [(1.3, True), (0.1, False)])
def test_pixels_must_speak_louder_for_a_motion_that_no_camera_makes(
    odometry: Odometry,
    look: SecondLook,
    right: Contradiction,
    leap_m: float,
    stays: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One shelf further in one frame: what repeats fits there by chance."""
    shift = se3.make(np.eye(3), [leap_m, 0.0, 0.0])
    wrong = Edge(right.i, right.j, right.T_i_j @ shift, np.eye(6))
    tempted = dataclasses.replace(as_likely(odometry, 0.99), alternatives=(wrong,))
    monkeypatch.setattr(look, "_odometry", tempted)
    misled = np.array([[0.0, -2.0, 50.0], [2.0, 0.0, 52.0], [-50.0, -52.0, 0.0]])
    monkeypatch.setattr(look, "log_odds", lambda *_: misled)
    found = look.correct(dataclasses.replace(right, T_i_j=wrong.T_i_j), right.T_i_j)
    assert (found is None) == stays
