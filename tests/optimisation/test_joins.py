"""The walk of the tiny capture as two segments, joined by closures of which most may be wrong.

Its odometry is right to millimetres. What is wrong are closures that agree with each other on one
place, as those of two rooms that look alike do.
"""

import dataclasses
from functools import partial

import numpy as np
import pytest

from vnav.config import Config
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.frame import Edge
from vnav.core.graph import chain
from vnav.core.mapping import Odometry
from vnav.io.store.artifacts import load_keyframe
from vnav.io.store.map_folder import MapFolder
from vnav.optimisation.joins import CLEARLY
from vnav.optimisation.robust_graph import RobustGraph, robust_pose_graph
from vnav.optimisation.second_look import LEAST_PAIRS, SecondLook
from vnav.registration.judge import CLEAR
from vnav.registration.surface_agreement import Agreement

RIGHT, WRONG = 3, 6  # closures
BOOK_M = 0.15
DRIFT_M = 0.12  # along x and z: 15 to 30 sigma of depth at 2 m
ELSEWHERE = se3.make(se3.exp_so3([0, 0.3, 0]), [1.0, 0, 0.4])  # y is down in the first camera


@pytest.fixture(scope="module")
def halves(odometry: Odometry) -> Odometry:
    """The first and the second half of the frames, without an edge between them."""
    middle = int(odometry.keyframe_rows[len(odometry.keyframes) // 2])
    edges = tuple(e for e in odometry.edges if (e.i < middle) == (e.j < middle))
    poses, segment = chain(len(odometry.frames), edges, odometry.keyframe_rows.tolist())
    assert set(segment.tolist()) == {0, 1}
    return dataclasses.replace(odometry, edges=edges, T_segment_camera=poses, segment=segment)


@pytest.fixture(scope="module")
def look(halves: Odometry, folder: MapFolder, camera: Intrinsics) -> SecondLook:
    views = partial(load_keyframe, folder, frames=halves.frames)
    return SecondLook(halves, [camera], views, Config())


def closures(odometry: Odometry, halves: Odometry, elsewhere: bool) -> list[Edge]:
    """Between keyframes of either half, all of which agree on where the second half is."""
    rows = odometry.keyframe_rows
    first, second = (rows[halves.segment[rows] == k].tolist() for k in (0, 1))
    T, moved = odometry.T_segment_camera, ELSEWHERE if elsewhere else np.eye(4)
    pairs = zip(first, reversed(second), strict=False)
    edges = [
        Edge(i, j, se3.inverse(T[i]) @ moved @ T[j], np.diag([1e5] * 3 + [1e4] * 3))
        for i, j in pairs
    ]
    return edges[: WRONG if elsewhere else RIGHT]


def second_moved(
    odometry: Odometry, halves: Odometry, by_m: list[float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Poses with the second half beside its place, and which frames are of either half."""
    first, second = (halves.segment == k for k in (0, 1))
    moved = np.where(second[:, None, None], se3.make(np.eye(3), by_m), np.eye(4))
    return moved @ odometry.T_segment_camera, first, second


def joined(halves: Odometry, edges: list[Edge], look: SecondLook | None) -> RobustGraph:
    return robust_pose_graph(halves, edges, Config().optimise, look)


def test_halves_are_joined_as_few_closures_say_that_images_bear_out(
    odometry: Odometry, halves: Odometry, look: SecondLook
) -> None:
    right, wrong = (closures(odometry, halves, elsewhere) for elsewhere in (False, True))
    assert (len(right), len(wrong)) == (RIGHT, WRONG)
    found = joined(halves, [*wrong, *right], look)
    assert not found.part.any()
    assert found.graph.kept.tolist() == [False] * WRONG + [True] * RIGHT


@pytest.mark.parametrize(("off_m", "is_right"), [(0.0, True), (DRIFT_M, True), (1.0, False)])
def test_images_bear_out_halves_that_drift_has_moved_and_none_that_are_elsewhere(
    off_m: float, is_right: bool, odometry: Odometry, halves: Odometry, look: SecondLook
) -> None:
    alignment = second_moved(odometry, halves, [off_m, 0, off_m])
    assert look.is_borne_out(*alignment) == is_right


@pytest.mark.parametrize(("off_m", "is_right"), [(0.0, True), (DRIFT_M, False)])
def test_images_are_sure_of_halves_that_stand_right_alone(
    off_m: float, is_right: bool, odometry: Odometry, halves: Odometry, look: SecondLook
) -> None:
    alignment = second_moved(odometry, halves, [off_m, 0, off_m])
    assert look.is_sure(*alignment) == is_right


@pytest.mark.parametrize("number", [0, 1, 2])
def test_images_tell_where_a_half_stands_from_places_a_book_apart(
    number: int, odometry: Odometry, halves: Odometry, look: SecondLook
) -> None:
    off_m = np.roll([0.0, BOOK_M, -BOOK_M], number).tolist()
    places = [second_moved(odometry, halves, [x, 0, 0])[0] for x in off_m]
    first, second = (halves.segment == k for k in (0, 1))
    log_odds = look.log_odds_across(places, first, second)
    np.fill_diagonal(log_odds, np.inf)
    assert (log_odds.min(1) > CLEAR).tolist() == [x == 0.0 for x in off_m]


@pytest.mark.parametrize(("off_m", "is_alike"), [(0.0, True), (DRIFT_M, False)])
def test_halves_show_the_same_things_where_they_stand_right_alone(
    off_m: float, is_alike: bool, odometry: Odometry, halves: Odometry, look: SecondLook
) -> None:
    alignment = second_moved(odometry, halves, [off_m, 0, off_m])
    assert (look.unlike(*alignment) < CLEARLY) == is_alike


def test_halves_that_share_nothing_show_no_different_things(
    odometry: Odometry, halves: Odometry, look: SecondLook
) -> None:
    assert look.unlike(*second_moved(odometry, halves, [100.0, 0, 0])) == 0


def test_images_that_share_nothing_do_not_tell_where_a_half_stands(
    odometry: Odometry, halves: Odometry, look: SecondLook
) -> None:
    poses, *sets = second_moved(odometry, halves, [100.0, 0, 0])
    assert not look.log_odds_across([poses, poses], *sets).any()


def test_images_are_not_sure_of_halves_that_few_keyframes_share(
    odometry: Odometry, halves: Odometry, look: SecondLook, monkeypatch: pytest.MonkeyPatch
) -> None:
    few = [Agreement(0, 1, 0.0, 0.0)] * (LEAST_PAIRS - 1)
    monkeypatch.setattr(look, "_across", lambda *_: (few, few))
    assert not look.is_sure(*second_moved(odometry, halves, [0, 0, 0]))


@pytest.mark.parametrize(("off_m", "is_right"), [(0.1, True), (3.0, False)])
def test_halves_that_follow_each_other_are_not_joined_by_a_leap(
    off_m: float,
    is_right: bool,
    odometry: Odometry,
    halves: Odometry,
    look: SecondLook,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Shelves that look the same bear out any of them."""
    monkeypatch.setattr(look, "_across", lambda *_: ([], []))
    alignment = second_moved(odometry, halves, [off_m, 0, 0])
    assert look.is_borne_out(*alignment) == is_right


def test_halves_stay_apart_where_images_bear_no_closure_out(
    odometry: Odometry, halves: Odometry, look: SecondLook
) -> None:
    found = joined(halves, closures(odometry, halves, elsewhere=True), look)
    np.testing.assert_array_equal(found.part, halves.segment)
    assert not found.graph.kept.any()


def test_without_images_most_closures_decide(odometry: Odometry, halves: Odometry) -> None:
    right, wrong = (closures(odometry, halves, elsewhere) for elsewhere in (False, True))
    found = joined(halves, [*wrong, *right], None)
    assert found.graph.kept.tolist() == [True] * WRONG + [False] * RIGHT
