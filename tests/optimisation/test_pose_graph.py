"""Pose graphs over walks in circles, whole or in segments, whose truth is known.

Noise is what the edges' own says.
"""

from dataclasses import replace

import numpy as np
import pytest

from vnav.core import se3
from vnav.core.frame import Edge
from vnav.core.graph import chain
from vnav.core.mapping import LOST
from vnav.optimisation import pose_graph
from vnav.optimisation.segments import align_segments
from vnav.synthetic.circle import INFORMATION, LAP, SIGMAS, edge, steps, walk

MAX_SIGMAS = 4.0
ONE = np.zeros(3 * LAP, np.int32)  # capture of every frame


def laps(T: np.ndarray, rng: np.random.Generator) -> list[Edge]:
    """True closures: every fourth frame with the one a lap later."""
    return [edge(T, k, k + LAP, rng) for k in range(0, len(T) - LAP, 4)]


def wrong(T: np.ndarray, count: int, rng: np.random.Generator) -> list[Edge]:
    """Closures between places far apart that claim to be one place, as sure of it as true ones."""
    found = []
    while len(found) < count:
        i, j = sorted(rng.integers(0, len(T), 2).tolist())
        if np.linalg.norm(T[i, :3, 3] - T[j, :3, 3]) > 1:
            found.append(Edge(i, j, se3.exp(0.1 * rng.standard_normal(6)), INFORMATION))
    return found


def errors(poses: np.ndarray, T: np.ndarray) -> np.ndarray:
    return np.linalg.norm(poses[:, :3, 3] - T[:, :3, 3], axis=1)


def chained(count: int, edges: list[Edge]) -> np.ndarray:
    return chain(count, edges, [0])[0]


def test_closures_take_the_drift_out() -> None:
    # By dead reckoning the heading of frame k is off by 0.002 sqrt(k): 25 mrad after 160 steps,
    # over a circle of 4 m. With closures to the lap before, four laps are measured as one: the
    # error left is that of a lap, a third and less.
    T, rng = walk(4 * LAP), np.random.default_rng(0)
    edges, closures = steps(T, rng), laps(T, rng)
    initial = chained(len(T), edges)
    graph = pose_graph.optimise(initial, edges, closures, MAX_SIGMAS)
    assert graph.kept.all()
    assert graph.error_after < graph.error_before
    assert errors(graph.T_world_camera, T).mean() < 0.5 * errors(initial, T).mean()


def test_the_error_left_is_what_the_noise_leaves() -> None:
    # Half the squared residuals: chi-squared of 6 degrees of freedom for each edge beyond what
    # the poses take up, halved; its scatter is sqrt(2 * 234) / 2 = 11.
    T, rng = walk(3 * LAP), np.random.default_rng(1)
    edges, closures = steps(T, rng), laps(T, rng)
    graph = pose_graph.optimise(chained(len(T), edges), edges, closures, MAX_SIGMAS)
    free = 6 * (len(edges) + len(closures) - len(T) + 1)
    assert graph.error_after == pytest.approx(free / 2, abs=4 * np.sqrt(2 * free) / 2)


@pytest.mark.parametrize("seed", range(4))
def test_wrong_closures_do_not_survive(seed: int) -> None:
    # One closure in ten is wrong and as sure of itself as the others.
    T, rng = walk(3 * LAP), np.random.default_rng(seed)
    edges, true = steps(T, rng), laps(T, rng)
    false = wrong(T, max(2, len(true) // 9), rng)
    initial = chained(len(T), edges)
    graph = pose_graph.optimise(initial, edges, [*true, *false], MAX_SIGMAS)
    assert graph.kept[: len(true)].all()
    assert not graph.kept[len(true) :].any()
    assert (graph.closure_sigmas[len(true) :] > MAX_SIGMAS).all()
    clean = pose_graph.optimise(initial, edges, true, MAX_SIGMAS)
    np.testing.assert_allclose(graph.T_world_camera, clean.T_world_camera, atol=1e-4)


def test_wrong_closures_do_not_survive_where_most_are_wrong() -> None:
    T, rng = walk(3 * LAP), np.random.default_rng(5)
    edges, true = steps(T, rng), laps(T, rng)
    false = wrong(T, len(true) + 5, rng)
    graph = pose_graph.optimise(chained(len(T), edges), edges, [*false, *true], MAX_SIGMAS)
    assert not graph.kept[: len(false)].any()
    assert graph.kept[len(false) :].all()


def test_right_closures_that_are_lost_among_wrong_ones_are_found_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Of a closure little is known: ten steps drift by a third of what it may be off.
    T, rng = walk(LAP // 2), np.random.default_rng(7)
    edges, noisy = steps(T, rng), INFORMATION / 10**2
    true = [replace(edge(T, k, k + 10, rng), information=noisy) for k in range(9)]
    monkeypatch.setattr(
        pose_graph, "_graduated_non_convexity", lambda _, values, n: (values, np.zeros(n, bool))
    )
    initial = chained(len(T), edges)
    graph = pose_graph.optimise(initial, edges, [*true, *wrong(T, 9, rng)], MAX_SIGMAS)
    assert graph.kept.tolist() == [True] * 9 + [False] * 9


def test_right_closures_that_the_initial_poses_bear_out_do_not_lose_to_a_wrong_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Which graduated non-convexity may leave alone, where right ones differ by more than noise."""
    T, rng = walk(2 * LAP), np.random.default_rng(3)
    edges = [e for e in steps(T, rng) if e.j != LAP]
    right = [edge(T, k, k + LAP, rng) for k in range(4)]
    away = Edge(5, LAP + 5, se3.make(np.eye(3), np.array([2.6, 0, 0])), INFORMATION)
    only_away = np.array([False] * len(right) + [True])
    monkeypatch.setattr(
        pose_graph, "_graduated_non_convexity", lambda _, values, n: (values, only_away.copy())
    )
    apart, segment = chain(len(T), edges, [0, LAP])
    initial, _ = align_segments(apart, segment, np.zeros(len(T), np.int32), right)
    graph = pose_graph.optimise(initial, edges, [*right, away], MAX_SIGMAS)
    assert graph.kept.tolist() == [True] * len(right) + [False]
    assert errors(graph.T_world_camera, T).max() < 0.26  # a tenth of what it is off


def test_a_lower_limit_refuses_what_a_higher_one_keeps() -> None:
    # Right closures lie about one sigma off, hardly one of them less than a fifth.
    T, rng = walk(2 * LAP), np.random.default_rng(16)
    edges, closures = steps(T, rng), laps(T, rng)
    initial = chained(len(T), edges)
    assert pose_graph.optimise(initial, edges, closures, MAX_SIGMAS).kept.all()
    assert pose_graph.optimise(initial, edges, closures, 0.2).kept.mean() < 0.5


def test_true_closures_survive_a_drift_that_always_goes_one_way() -> None:
    # A wrong focal length bends every step by one sigma to the same side: 5 degrees a lap, 40
    # sigmas of a closure, and yet no edge is off by more than two.
    T, rng = walk(2 * LAP), np.random.default_rng(6)
    bend = se3.exp([0, 0, SIGMAS[2], SIGMAS[3], 0, 0])
    edges = [Edge(e.i, e.j, e.T_i_j @ bend, INFORMATION) for e in steps(T, rng)]
    graph = pose_graph.optimise(chained(len(T), edges), edges, laps(T, rng), MAX_SIGMAS)
    assert graph.kept.all()


def test_without_closures_nothing_moves() -> None:
    T, rng = walk(LAP), np.random.default_rng(7)
    edges = steps(T, rng)
    initial = chained(LAP, edges)
    graph = pose_graph.optimise(initial, edges, [], MAX_SIGMAS)
    np.testing.assert_allclose(graph.T_world_camera, initial, atol=1e-6)
    assert graph.kept.shape == graph.closure_sigmas.shape == (0,)


def test_frames_that_no_edge_reaches_stay_nan() -> None:
    T, rng = walk(2 * LAP), np.random.default_rng(8)
    edges, closures = steps(T, rng)[1:], laps(T, rng)[1:]
    initial, _ = chain(len(T), edges, [1])
    graph = pose_graph.optimise(initial, edges, closures, MAX_SIGMAS)
    assert np.isnan(graph.T_world_camera[0]).all()
    assert np.isfinite(graph.T_world_camera[1:]).all()


def test_the_same_graph_gives_the_same_bytes() -> None:
    T, rng = walk(2 * LAP), np.random.default_rng(9)
    edges, closures = steps(T, rng), [*laps(T, rng), *wrong(T, 2, rng)]
    initial = chained(len(T), edges)
    first, second = (
        pose_graph.optimise(initial, edges, closures, MAX_SIGMAS).T_world_camera for _ in range(2)
    )
    assert first.tobytes() == second.tobytes()


def two_segments(
    T: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, list[Edge]]:
    """Two laps as two segments, each in a frame of reference of its own, and their edges."""
    edges = [e for e in steps(T, rng) if e.i != LAP - 1]
    return *chain(len(T), edges, [0, LAP]), edges


def test_given_poses_stay_and_closures_that_disagree_are_rejected() -> None:
    rng, T = np.random.default_rng(8), walk(2 * LAP)
    T[5] = np.nan
    right = [e for e in laps(T, rng) if e.i != 5]
    found = pose_graph.check_closures(T, [*right, *wrong(walk(2 * LAP), 5, rng)], MAX_SIGMAS)
    np.testing.assert_array_equal(found.T_world_camera, T)
    assert found.kept.tolist() == [True] * len(right) + [False] * 5
    assert found.closure_sigmas[: len(right)].max() < MAX_SIGMAS  # 24 / 6 squared: once in 10^17


def test_given_poses_without_closures_are_legal() -> None:
    assert pose_graph.check_closures(walk(3), [], MAX_SIGMAS).kept.tolist() == []


def test_segments_are_joined_where_closures_agree() -> None:
    # Half of the closures between the segments are wrong, each in its own way.
    T, rng = walk(2 * LAP), np.random.default_rng(10)
    poses, segment, edges = two_segments(T, rng)
    crossing = [e for e in wrong(T, 60, rng) if e.i < LAP <= e.j][:10]
    closures = [*crossing, *laps(T, rng)]
    joined, part = align_segments(poses, segment, ONE, closures)
    assert not part.any()
    # The second segment hangs on one closure, which drift in either lap may put off: 2 mrad a
    # step over 40 steps and 4 m, and 5 mm a step: 0.05 + 0.03 m; three times that.
    assert errors(joined, T).max() < 0.25
    graph = pose_graph.optimise(joined, edges, closures, MAX_SIGMAS)
    assert graph.kept.tolist() == [False] * len(crossing) + [True] * 10


def test_segments_that_no_closure_joins_stay_apart() -> None:
    T, rng = walk(2 * LAP), np.random.default_rng(11)
    poses, segment, edges = two_segments(T, rng)
    inside = [edge(T, 0, 20, rng)]
    joined, part = align_segments(poses, segment, ONE, inside)
    np.testing.assert_array_equal(part, segment)
    np.testing.assert_array_equal(joined, poses)
    graph = pose_graph.optimise(joined, edges, inside, MAX_SIGMAS)
    assert np.isfinite(graph.T_world_camera).all()


def test_three_segments_become_one_part_by_way_of_the_middle_one() -> None:
    T, rng = walk(3 * LAP), np.random.default_rng(12)
    edges = [e for e in steps(T, rng) if e.j % LAP]
    poses, segment = chain(len(T), edges, [0, LAP, 2 * LAP])
    joined, part = align_segments(poses, segment, ONE, laps(T, rng))
    assert not part.any()
    assert errors(joined, T).max() < 0.5  # twice the limit of two segments


@pytest.mark.parametrize(("closures", "joined"), [(2, False), (3, True)])
def test_captures_are_joined_where_three_closures_agree(closures: int, joined: bool) -> None:
    T, rng = walk(2 * LAP), np.random.default_rng(14)
    poses, segment, _ = two_segments(T, rng)
    crossing = [e for e in wrong(T, 60, rng) if e.i < LAP <= e.j][:5]  # each in its own way
    found = [*crossing, *laps(T, rng)[:closures]]
    _, part = align_segments(poses, segment, segment, found)
    assert (not part.any()) == joined
    _, part = align_segments(poses, segment, ONE, found[:1])
    assert not part.any()  # within a capture one will do


def test_a_capture_that_is_joined_does_not_vouch_for_its_other_segments() -> None:
    # Three segments, the last two of one capture; one closure leads from the first to the last.
    T, rng = walk(3 * LAP), np.random.default_rng(15)
    edges = [e for e in steps(T, rng) if e.j % LAP]
    poses, segment = chain(len(T), edges, [0, LAP, 2 * LAP])
    capture = np.minimum(segment, 1)
    between = [e for e in laps(T, rng) if e.j < 2 * LAP]
    _, part = align_segments(poses, segment, capture, [*between, edge(T, 3, 2 * LAP + 3, rng)])
    assert np.unique(part).tolist() == [0, 2]
    inside = edge(T, LAP + 3, 2 * LAP + 3, rng)
    _, part = align_segments(poses, segment, capture, [*between, inside])
    assert not part.any()


def test_lost_frames_belong_to_no_part() -> None:
    T, rng = walk(2 * LAP), np.random.default_rng(13)
    poses, segment, _ = two_segments(T, rng)
    poses[5], segment[5] = np.nan, LOST
    joined, part = align_segments(poses, segment, ONE, laps(T, rng)[2:])
    assert part[5] == LOST
    assert np.isnan(joined[5]).all()


def test_fixed_poses_stay_and_the_others_share_the_error() -> None:
    # Fixed ends 0.1 m farther apart than the edges say: the frames between share it evenly.
    T = np.stack([se3.make(np.eye(3), [k, 0, 0]) for k in range(5)])
    edges = [Edge(k, k + 1, T[1], INFORMATION) for k in range(4)]
    moved = T.copy()
    moved[4, 0, 3] = 4.1
    found = pose_graph.optimise_others(moved, edges, np.array([0, 4]))
    np.testing.assert_allclose(found[[0, 4]], moved[[0, 4]], atol=1e-9)
    np.testing.assert_allclose(found[:, 0, 3], [0, 1.025, 2.05, 3.075, 4.1], atol=1e-4)


def test_frames_without_a_pose_stay_nan_beside_fixed_ones() -> None:
    T = np.stack([np.eye(4)] * 3)
    T[2] = np.nan
    found = pose_graph.optimise_others(T, [Edge(0, 1, np.eye(4), INFORMATION)], np.array([0]))
    assert np.isnan(found[2]).all()
    assert np.isfinite(found[:2]).all()


def test_the_self_test_passes() -> None:
    pose_graph.self_test()
