"""Odometry across an interruption, on a walk in a circle whose truth is known.

Ten frames a second, and a second without any before frame 40. Noise is what the edges' own says,
5 mm and 2 mrad; a place that looks like the camera's is 1.5 m beside it or more, 300 times as far.
"""

import dataclasses
from collections.abc import Callable, Sequence
from itertools import compress

import numpy as np
import pytest

from tests.optimisation.walks import EVERY, FixedLook, walked
from vnav.config import OptimiseConfig
from vnav.core import se3
from vnav.core.frame import Edge
from vnav.core.mapping import LOST, FrameTable, Odometry
from vnav.optimisation.interruptions import Passage, claims, lie_apart, passages
from vnav.optimisation.mending import (
    ALIKE,
    CUT,
    INTERRUPTED,
    LEFT_OUT,
    TAKEN,
    Mend,
    with_edges,
)
from vnav.optimisation.robust_graph import RobustGraph, robust_pose_graph
from vnav.optimisation.second_look import MOST_THROUGH
from vnav.optimisation.segments import SAME_POSE_M
from vnav.synthetic.circle import LAP, edge, walk

FIRST = LAP  # frame after the interruption, a keyframe
BESIDE = se3.make(np.eye(3), [0, 1.5, 0.2])  # to the left of the first camera, which looks along x
T = walk(2 * LAP)
BESIDE_M = float(np.linalg.norm(BESIDE[:3, 3]))
MOST_OFF_M = 0.02  # of the half's place: four times the noise of an edge
BOOK_M = 0.15  # what looks alike is so far apart, too, and that is one place until images tell
BOOK = BOOK_M / BESIDE_M
Judge = Callable[[np.ndarray], bool]


def stamped(
    odometry: Odometry, step_s: float = 0.1, lost_s: float = 1.0, first: int = FIRST
) -> Odometry:
    """The same with so much time between frames, and more before the first after it."""
    rows = np.arange(len(odometry.frames))
    stamps_s = rows * step_s + lost_s * (rows >= first)
    table = FrameTable(np.zeros(len(rows)), rows, stamps_s)
    return dataclasses.replace(odometry, frames=table)


def moved(times: float) -> np.ndarray:
    """The walk whose second half lies beside its place."""
    there = T.copy()
    there[FIRST:] = se3.make(np.eye(3), times * BESIDE[:3, 3]) @ there[FIRST:]
    return there


def closures(times: float, count: int, seed: int = 3) -> list[Edge]:
    """Between keyframes of either half, where the second lies so far beside its place."""
    rng = np.random.default_rng(seed)
    return [edge(moved(times), EVERY * k, FIRST + EVERY * k, rng) for k in range(count)]


def beside(poses: np.ndarray, times: float = 0.0) -> float:
    """How far the second half is, in metres, from so many times beside its place."""
    at_m, true_m = ((se3.inverse(P[0]) @ P[FIRST])[:3, 3] for P in (poses, T))
    return float(np.linalg.norm(at_m - true_m - times * BESIDE[:3, 3]))


class PlacesLook(FixedLook):
    """A second look that bears out, or is sure of, alignments by where the second half lies.

    ``clear``: log-odds of where it is over a book beside that; ``through``: share of pairs that see
    through what the other sees, where it is borne out; ``alike``: where none shows something else.
    """

    def __init__(
        self,
        borne_out: Judge,
        sure: Judge = lambda _: False,
        clear: float = 0.0,
        through: float = 0.0,
        alike: Judge = lambda _: False,
    ) -> None:
        super().__init__(None)
        self._borne_out, self._sure, self._clear = borne_out, sure, clear
        self._through, self._alike = through, alike

    def is_borne_out(
        self, poses: np.ndarray, a: object, b: object, most_through: float = MOST_THROUGH
    ) -> bool:
        return self._borne_out(poses) and self._through <= most_through

    def is_sure(self, poses: np.ndarray, *_: object) -> bool:
        return self._sure(poses)

    def unlike(self, poses: np.ndarray, *_: object) -> float:
        return 0.0 if self._alike(poses) else 0.3

    def log_odds_across(self, places: Sequence[np.ndarray], *_: object) -> np.ndarray:
        favour = np.array([self._clear * (beside(poses) < BOOK_M / 2) for poses in places])
        return favour[:, None] - favour


def lies(*times: float) -> Judge:
    """Whether the second half lies so far beside its place, by less than 0.3 m."""

    def judge(poses: np.ndarray) -> bool:
        return any(beside(poses, t) < SAME_POSE_M for t in times)

    return judge


def joined(times: float, found: list[Edge], look: PlacesLook) -> RobustGraph:
    """Odometry that claims so of the second half, held against closures."""
    odometry = stamped(walked(moved(times)))
    return robust_pose_graph(odometry, found, OptimiseConfig(), look)  # type: ignore[arg-type]


def test_edges_across_an_interruption_are_claims() -> None:
    odometry = stamped(walked(T))
    claimed = [(e.i, e.j) for e in compress(odometry.edges, claims(odometry))]
    across = [(e.i, e.j) for e in odometry.edges if e.i < FIRST <= e.j]
    assert claimed == across == [(36, 40), (39, 40)]


@pytest.mark.parametrize(("step_s", "lost_s"), [(0.1, 0.2), (0.5, 0.8), (2.0, 0.0)])
def test_what_a_hand_goes_on_for_or_a_slow_camera_waits_is_no_interruption(
    step_s: float, lost_s: float
) -> None:
    assert not claims(stamped(walked(T), step_s, lost_s)).any()


def test_edges_to_frames_that_nothing_else_holds_are_no_claims() -> None:
    # Frames 41 and 42 are no keyframes, and the recording ends there.
    assert not claims(stamped(walked(T[:43]), first=41)).any()
    assert claims(stamped(walked(T[:45]), first=41)).any()


def test_a_claim_that_images_bear_out_stays() -> None:
    robust = joined(0, [], PlacesLook(lies(0)))
    assert robust.mends == ()
    assert not robust.odometry.segment.any()
    assert not robust.part.any()


def test_a_claim_that_images_refute_is_cut() -> None:
    robust = joined(1, [], PlacesLook(lies(0)))
    assert robust.mends == (Mend(FIRST, FIRST, CUT, why=INTERRUPTED),)
    assert robust.part.tolist() == [0] * FIRST + [1] * (len(T) - FIRST)
    assert LOST not in robust.odometry.segment


def test_closures_that_images_bear_out_win_against_a_claim_and_more_that_agree_with_it() -> None:
    right, wrong = closures(0, 2), closures(1, 6, seed=4)
    robust = joined(1, [*wrong, *right], PlacesLook(lies(0)))
    assert robust.mends == (Mend(FIRST, FIRST, LEFT_OUT, why=INTERRUPTED),)
    assert robust.graph.kept.tolist() == [False] * 6 + [True] * 2
    assert lies(0)(robust.graph.T_world_camera)


def test_of_several_places_that_images_bear_out_the_one_is_right_that_all_agree_on() -> None:
    found = [*closures(1, 6), *closures(0, 2, seed=4)]
    robust = joined(1, found, PlacesLook(lies(0, 1), sure=lies(0)))
    assert robust.graph.kept.tolist() == [False] * 6 + [True] * 2


@pytest.mark.parametrize("sure", [lies(), lies(0, 1)])
def test_where_nothing_tells_two_places_apart_a_walk_is_cut(sure: Judge) -> None:
    found = [*closures(1, 6), *closures(0, 2, seed=4)]
    robust = joined(1, found, PlacesLook(lies(0, 1), sure))
    assert not robust.graph.kept.any()
    assert robust.part.tolist() == [0] * FIRST + [1] * (len(T) - FIRST)


def test_of_places_that_images_are_sure_of_the_one_is_taken_that_shows_nothing_else() -> None:
    found = [*closures(1, 6), *closures(0, 2, seed=4)]
    robust = joined(1, found, PlacesLook(lies(0, 1), sure=lies(0, 1), alike=lies(0)))
    assert robust.graph.kept.tolist() == [False] * 6 + [True] * 2
    assert [mend.how for mend in robust.mends] == [LEFT_OUT, TAKEN]


def of_two_captures(look: PlacesLook, found: list[Edge]) -> RobustGraph:
    """The walk's halves as recordings of their own."""
    odometry = stamped(walked(T))
    captures = (np.arange(len(T)) >= FIRST).astype(np.int32)
    frames = dataclasses.replace(odometry.frames, capture=captures)
    edges = [e for e in odometry.edges if not e.i < FIRST <= e.j]
    halves = with_edges(dataclasses.replace(odometry, frames=frames), edges)
    return robust_pose_graph(halves, found, OptimiseConfig(), look)  # type: ignore[arg-type]


@pytest.mark.parametrize(("alike", "place"), [(lies(0), 0), (lies(), 1)])
def test_of_places_of_another_recording_the_one_is_taken_that_shows_nothing_else_or_most_are_for(
    alike: Judge, place: int
) -> None:
    found = [*closures(1, 6), *closures(0, 4, seed=4)]
    robust = of_two_captures(PlacesLook(lies(0, 1), sure=lies(0, 1), alike=alike), found)
    assert lies(place)(robust.graph.T_world_camera)
    assert robust.mends == (Mend(FIRST, len(T) - 1, TAKEN, why=ALIKE),)


def test_the_only_place_of_another_recording_is_taken_without_a_word() -> None:
    robust = of_two_captures(PlacesLook(lies(0)), closures(0, 4))
    assert not robust.part.any()
    assert robust.mends == ()


def test_a_place_that_is_farther_than_a_camera_goes_elsewhere_is_not_taken() -> None:
    # In 1.1 s the walk goes 2.6 m at most; it would have come 10 m aside.
    found = [*closures(7, 6), *closures(0, 2, seed=4)]
    robust = joined(7, found, PlacesLook(lies(0, 7), sure=lies(0, 7)))
    assert robust.graph.kept.tolist() == [False] * 6 + [True] * 2


@pytest.mark.parametrize(("others", "how"), [(0, TAKEN), (1, TAKEN), (4, CUT)])
def test_a_place_far_off_is_taken_where_hardly_any_votes_are_for_others_and_told_of(
    others: int, how: str
) -> None:
    # Ten votes are for it: two claims of odometry, and eight closures.
    found = [*closures(5, 8), *closures(3, others, seed=4)]
    robust = joined(5, found, PlacesLook(lies(5)))
    assert [mend.how for mend in robust.mends] == [how]
    assert bool(robust.part.any()) == (how == CUT)


def straight(*places_m: float) -> np.ndarray:
    """Poses (N, 4, 4) along x."""
    return se3.make(np.eye(3), np.outer(places_m, [1.0, 0, 0]))


def test_a_passage_tells_how_far_a_camera_is_from_where_it_would_have_gone_on() -> None:
    # 1 m/s for 2 s, then a second unseen; elsewhere it goes on for a second to the millimetre,
    # but where it started: there its velocity is not known, and it goes 1 m farther than that.
    count = 21
    poses = straight(*(0.1 * np.arange(count)), 2.5, 2.6)
    stamps_s = np.append(0.1 * np.arange(count), [3.0, 3.1])
    table = FrameTable(np.zeros(count + 2), np.arange(count + 2), stamps_s)
    first = np.arange(count + 2) < count
    (passage,) = passages(table, poses, first, ~first)
    assert passage.at_m.tolist() == [2.5, 0, 0]
    assert passage.off_m == pytest.approx(0.5)
    assert passage.most_m == pytest.approx(1.25)
    assert passage.is_usual


@pytest.mark.parametrize(("apart_m", "expected"), [(2.1, True), (1.9, False)])
def test_two_ways_lie_apart_where_at_most_one_of_them_may_be_usual(
    apart_m: float, expected: bool
) -> None:
    ends = [[Passage(0, 1, np.array([x, 0, 0]), x, 1.0)] for x in (0.0, apart_m)]
    assert lie_apart(ends) is expected


@pytest.mark.parametrize("ways", [[], [[]], [[], []]])
def test_ways_that_pass_no_time_do_not_lie_apart(ways: list[list[Passage]]) -> None:
    assert not lie_apart(ways)


def test_where_images_refute_all_of_several_places_a_walk_is_cut() -> None:
    robust = joined(1, [*closures(1, 6), *closures(0, 2, seed=4)], PlacesLook(lies()))
    assert not robust.graph.kept.any()
    assert robust.part.tolist() == [0] * FIRST + [1] * (len(T) - FIRST)


@pytest.mark.parametrize(("through", "how"), [(0.2, []), (0.3, [TAKEN]), (0.6, [CUT])])
def test_a_place_that_somebody_may_have_left_meanwhile_is_taken_and_told_of(
    through: float, how: list[str]
) -> None:
    robust = joined(0, closures(0, 4), PlacesLook(lies(0), through=through))
    assert [mend.how for mend in robust.mends] == how
    assert bool(robust.part.any()) == (CUT in how)


def test_a_place_that_others_may_be_taken_for_is_not_taken_where_something_has_left() -> None:
    found = [*closures(0, 4), *closures(1, 4, seed=4)]
    robust = joined(0, found, PlacesLook(lies(0), through=0.3))
    assert [mend.how for mend in robust.mends] == [CUT]


def test_of_places_a_book_apart_images_tell_which_however_many_are_for_the_other() -> None:
    found = [*closures(BOOK, 3), *closures(0, 2, seed=4)]
    robust = joined(BOOK, found, PlacesLook(lies(0), clear=5.0))
    assert robust.mends == (Mend(FIRST, FIRST, LEFT_OUT, why=INTERRUPTED),)
    assert robust.graph.kept.tolist() == [False] * 3 + [True] * 2
    assert beside(robust.graph.T_world_camera) < MOST_OFF_M


def test_where_images_do_not_tell_places_a_book_apart_most_count_and_it_is_told_of() -> None:
    found = [*closures(BOOK, 1), *closures(0, 4, seed=4)]
    robust = joined(BOOK, found, PlacesLook(lies(0)))
    assert robust.mends == (Mend(FIRST - 1, FIRST, TAKEN, why=INTERRUPTED),)
    assert robust.graph.kept.tolist() == [False] + [True] * 4


def test_closures_that_are_off_by_what_does_no_harm_make_no_other_place() -> None:
    robust = joined(0, closures(0.02 / BESIDE_M, 2), PlacesLook(lies(0)))
    assert robust.mends == ()
