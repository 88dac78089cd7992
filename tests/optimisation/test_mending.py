"""Odometry with wrong edges, on a walk in a circle whose truth is known.

Every fourth frame is a keyframe; each frame has an edge from the last keyframe and from its
predecessor. Noise is what the edges' own says, 5 mm and 2 mrad. A wrong edge is 0.2 m off: three
edges around a triangle are off by 9 mm together, and each direction shows it with 7 sigmas or more.
"""

import dataclasses

import numpy as np
import pytest

from tests.optimisation.walks import EVERY, FixedLook, of_edges, walked
from vnav.config import OptimiseConfig
from vnav.core import se3
from vnav.core.frame import Edge
from vnav.core.mapping import LOST, Odometry
from vnav.optimisation.contradictions import Contradiction, contradictions
from vnav.optimisation.cycles import noise_factor, suspects
from vnav.optimisation.mending import CUT, LEFT_OUT, REGISTERED_AGAIN, TOO_FAST, Mend, mend
from vnav.optimisation.robust_graph import robust_pose_graph
from vnav.optimisation.second_look import Correction
from vnav.synthetic.circle import LAP, edge, walk

CONFIG = OptimiseConfig()
SHIFT = se3.make(np.eye(3), [0.1, -0.17, 0.03])  # 0.2 m


def broken(odometry: Odometry, *pairs: tuple[int, int]) -> Odometry:
    """The same with these edges shifted, each a little further than the one before."""
    shifts = {pair: np.linalg.matrix_power(SHIFT, n) for n, pair in enumerate(pairs, 1)}
    edges = [
        dataclasses.replace(e, T_i_j=e.T_i_j @ shifts.get((e.i, e.j), np.eye(4)))
        for e in odometry.edges
    ]
    return of_edges(edges, len(odometry.frames))


def pairs_of(odometry: Odometry) -> set[tuple[int, int]]:
    return {(e.i, e.j) for e in odometry.edges}


def near_closures(T: np.ndarray, rng: np.random.Generator) -> list[Edge]:
    """Each keyframe with the next two."""
    rows = range(0, len(T), EVERY)
    return [edge(T, i, j, rng) for i in rows for j in (i + 4, i + 8) if j < len(T)]


@pytest.mark.parametrize("seed", range(5))
def test_odometry_that_agrees_stays_as_it_is(seed: int) -> None:
    odometry = walked(walk(LAP), seed)
    assert not suspects(odometry.edges, 4.0).any()
    assert mend(odometry, (), (), CONFIG).odometry is odometry


@pytest.mark.parametrize("pair", [(8, 10), (8, 11), (10, 11)])
def test_a_wrong_edge_whose_frame_has_others_is_left_out(pair: tuple[int, int]) -> None:
    odometry = walked(walk(LAP))
    mended = mend(broken(odometry, pair), (), (), CONFIG)
    assert pairs_of(mended.odometry) == pairs_of(odometry) - {pair}
    assert mended.mends == (Mend(pair[1], pair[1], LEFT_OUT),)
    assert not mended.odometry.segment.any()


@pytest.mark.parametrize("seed", range(5))
def test_several_wrong_edges_are_left_out_together(seed: int) -> None:
    pairs = {(8, 10), (14, 15), (16, 19), (26, 27), (32, 34)}
    odometry = walked(walk(2 * LAP), seed)
    mended = mend(broken(odometry, *pairs), (), (), CONFIG)
    assert pairs_of(mended.odometry) == pairs_of(odometry) - pairs


@pytest.mark.parametrize("pair", [(8, 9), (9, 10)])
def test_a_frame_with_two_edges_that_contradict_each_other_is_cut(pair: tuple[int, int]) -> None:
    # Frame 9 has no third edge: either of the two may be the wrong one.
    mended = mend(broken(walked(walk(LAP)), pair), (), (), CONFIG)
    assert np.flatnonzero(mended.odometry.segment == LOST).tolist() == [9]
    assert mended.odometry.reasons[9]
    assert mended.mends[0] == Mend(9, 9, CUT)


def test_a_frame_with_two_wrong_edges_is_cut() -> None:
    # And frame 9 with it, whose only other edge is then tested by nothing.
    mended = mend(broken(walked(walk(LAP)), (8, 10), (9, 10)), (), (), CONFIG)
    assert np.flatnonzero(mended.odometry.segment == LOST).tolist() == [9, 10]


def test_an_alternative_that_agrees_stands_in_for_a_wrong_edge() -> None:
    T = walk(LAP)
    right = edge(T, 8, 10, np.random.default_rng(1))
    odometry = dataclasses.replace(broken(walked(T), (8, 10)), alternatives=(right,))
    mended = mend(odometry, (), (), CONFIG).odometry
    assert any(e is right for e in mended.edges)
    assert len(mended.edges) == len(odometry.edges)


@pytest.mark.parametrize("pair", [(8, 12), (11, 12)])
def test_closures_tell_which_of_two_edges_joins_keyframes(pair: tuple[int, int]) -> None:
    T = walk(LAP)
    odometry = walked(T)
    closures = near_closures(T, np.random.default_rng(2))
    mended = mend(broken(odometry, pair), (), closures, CONFIG)
    assert pairs_of(mended.odometry) == pairs_of(odometry) - {pair}


def test_where_nothing_tells_odometry_is_cut_in_two() -> None:
    mended = mend(broken(walked(walk(LAP)), (8, 12)), (), (), CONFIG)
    segment = mended.odometry.segment
    assert segment.tolist() == [0] * 12 + [1] * (LAP - 12)
    assert mended.mends == (Mend(12, 12, CUT),)


def test_an_alternative_wins_where_closures_agree_with_it() -> None:
    T, rng = walk(LAP), np.random.default_rng(3)
    right = edge(T, 8, 12, rng)
    odometry = broken(walked(T), (8, 12), (11, 12))
    odometry = dataclasses.replace(odometry, alternatives=(right,))
    mended = mend(odometry, (), near_closures(T, rng), CONFIG).odometry
    assert any(e is right for e in mended.edges)
    assert not mended.segment.any()
    assert not {(8, 12), (11, 12)} & {(e.i, e.j) for e in mended.edges if e is not right}


def test_edges_that_claim_too_little_noise_are_no_suspects() -> None:
    # A third of the noise that they have, as of frames read out line by line: a triangle of 4.5
    # sigmas and more among 40 is expected to be off; none is, in units of the noise that they show.
    odometry = walked(walk(3 * LAP))
    sure = [dataclasses.replace(e, information=9 * e.information) for e in odometry.edges]
    assert noise_factor(sure) == pytest.approx(3, rel=0.2)
    assert not suspects(sure, 4.0).any()


def jump(T: np.ndarray) -> Odometry:
    """Odometry whose edges into frame 48 all have the same shift: no cycle shows it."""
    odometry = walked(T)
    edges = [
        dataclasses.replace(e, T_i_j=e.T_i_j @ SHIFT) if e.j == 48 else e for e in odometry.edges
    ]
    return of_edges(edges, len(T))


def test_closures_that_contradict_a_stretch_name_it_and_its_motion() -> None:
    T = walk(2 * LAP)
    closures = near_closures(T, np.random.default_rng(4))
    robust = robust_pose_graph(jump(T), closures, CONFIG, None)
    (found,) = contradictions(
        robust.odometry, robust.graph.T_world_camera, closures, robust.graph.kept
    )
    assert (found.i, found.j) == (44, 48)
    assert found.closures == 3  # 40 to 48, 44 to 48, 44 to 52
    off = se3.inverse(se3.inverse(T[44]) @ T[48]) @ found.T_i_j
    assert np.linalg.norm(off[:3, 3]) < 0.05  # of 0.2: each of the three is off by 9 mm and a turn


def test_a_stretch_registered_again_brings_its_closures_back() -> None:
    T, rng = walk(2 * LAP), np.random.default_rng(5)
    closures = near_closures(T, rng)
    again = edge(T, 44, 48, rng)
    robust = robust_pose_graph(jump(T), closures, CONFIG, FixedLook(again))  # type: ignore[arg-type]
    assert robust.graph.kept.all()
    assert robust.mends == (Mend(44, 48, REGISTERED_AGAIN, 3),)
    assert any(e is again for e in robust.odometry.edges)


def test_a_stretch_is_cut_before_the_frame_whose_motion_is_least_likely() -> None:
    T, rng = walk(2 * LAP), np.random.default_rng(5)
    odometry = walked(T)
    edges = [dataclasses.replace(e, probability=0.4 if e.j == 46 else 1) for e in odometry.edges]
    stretch = Contradiction(44, 48, se3.inverse(T[44]) @ T[48], 3)
    mended = mend(
        of_edges(edges, len(T)), [Correction(stretch, None)], near_closures(T, rng), CONFIG
    )
    segment = mended.odometry.segment
    assert len(set(segment[:46])) == len(set(segment[46:])) == 1
    assert segment[45] != segment[46]


def test_odometry_that_its_pixels_bear_out_stays_against_any_number_of_closures() -> None:
    # Forty closures agree that a lap of the walk lies 4 m beside the other, as a room's twin does.
    # Over 80 frames odometry drifts by 0.05 m and by 0.02 rad of 4 m: a hundredth of it.
    T, rng = walk(2 * LAP), np.random.default_rng(6)
    odometry, true = walked(T), near_closures(T, rng)
    wrong = T.copy()
    wrong[LAP:] = se3.make(np.eye(3), [3.2, 2.4, 0]) @ wrong[LAP:]
    ends = rng.integers(0, LAP // EVERY, (40, 2)) * EVERY + [0, LAP]
    false = [edge(wrong, i, j, rng) for i, j in ends.tolist()]
    look = FixedLook(None)
    robust = robust_pose_graph(odometry, [*true, *false], CONFIG, look)  # type: ignore[arg-type]
    assert look.asked > 0
    assert robust.graph.kept.tolist() == [True] * len(true) + [False] * 40
    assert robust.odometry is odometry


@pytest.mark.parametrize("closed", [False, True])
def test_frames_that_jump_away_and_back_are_left_out_with_their_closures(closed: bool) -> None:
    T, true = walk(2 * LAP), walk(2 * LAP)
    away = slice(46, 50)  # with keyframe 48
    T[away] = se3.make(np.eye(3), [0, 3.0, 0]) @ T[away]
    closures = near_closures(T if closed else true, np.random.default_rng(7))
    robust = robust_pose_graph(walked(T), closures, CONFIG, None)
    assert robust.mends[0] == Mend(46, 49, CUT, why=TOO_FAST)
    assert {robust.odometry.reasons[row] for row in (46, 47, 49)} == {TOO_FAST}
    pairs = zip(closures, robust.graph.kept, strict=True)
    assert not any(kept and 48 in (e.i, e.j) for e, kept in pairs)
    around = np.delete(np.arange(len(T)), away)
    assert len(set(robust.part[around])) == 1
    off = se3.inverse(robust.graph.T_world_camera[44]) @ robust.graph.T_world_camera[52]
    error = se3.inverse(se3.inverse(true[44]) @ true[52]) @ off
    assert np.linalg.norm(error[:3, 3]) < 0.05


def found_again(T: np.ndarray, source: int) -> Odometry:
    """Odometry that lost the track before frame 48, and found it again by a frame; wrongly."""
    T = T.copy()
    T[48:] = se3.make(np.eye(3), [0, 3.0, 0]) @ T[48:]
    rng, edges = np.random.default_rng(8), walked(T).edges
    kept = [e for e in edges if not e.i < 48 <= e.j]
    return of_edges([*kept, edge(T, source, 48, rng)], len(T))


def test_a_place_that_is_found_again_far_from_the_frame_before_is_not_believed() -> None:
    mended = mend(found_again(walk(2 * LAP), 8), [], [], CONFIG)
    segment = mended.odometry.segment
    assert mended.mends == (Mend(48, 48, CUT, why=TOO_FAST),)
    assert len(set(segment[:48])) == len(set(segment[48:])) == 1
    assert segment[47] != segment[48]


def test_a_track_that_goes_on_from_the_frame_before_is_not_cut_where_it_jumps() -> None:
    mended = mend(found_again(walk(2 * LAP), 47), [], [], CONFIG)
    assert set(mended.odometry.segment.tolist()) == {0}


class RefusingLook(FixedLook):
    """A second look that corrects nothing, and bears out no join."""

    def is_borne_out(self, *_: object, **__: object) -> bool:
        return False


def test_frames_that_jump_are_left_out_beside_closures_that_join_nothing() -> None:
    T = walk(2 * LAP)
    T[46:50] = se3.make(np.eye(3), [0, 3.0, 0]) @ T[46:50]
    edges = [e for e in walked(T).edges if not e.i < 20 <= e.j]
    closures = near_closures(T, np.random.default_rng(9))
    look = RefusingLook(None)
    robust = robust_pose_graph(of_edges(edges, len(T)), closures, CONFIG, look)  # type: ignore[arg-type]
    assert robust.mends[0] == Mend(46, 49, CUT, why=TOO_FAST)
    pairs = zip(closures, robust.graph.kept, strict=True)
    kept = [(e.i, e.j) for e, is_kept in pairs if is_kept]
    assert (0, 4) in kept
    assert not any(i < 20 <= j for i, j in kept)
