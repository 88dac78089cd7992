"""Walks over a graph of frames whose edges and noise are known."""

import numpy as np
import pytest

from vnav.core import se3
from vnav.core.frame import Edge
from vnav.core.graph import chain, component_roots, off_edges, propagate_poses, shortest_paths
from vnav.core.mapping import LOST
from vnav.synthetic.circle import INFORMATION, LAP, steps, walk


def chained(count: int, edges: list[Edge]) -> np.ndarray:
    return chain(count, edges, [0])[0]


def test_chained_exact_edges_give_the_walk() -> None:
    T = walk(LAP)
    exact = [Edge(k, k + 1, se3.inverse(T[k]) @ T[k + 1], INFORMATION) for k in range(LAP - 1)]
    poses, segment = chain(LAP, exact, [0])
    np.testing.assert_allclose(poses, T, atol=1e-9)
    assert not segment.any()


def test_edges_chain_backwards_as_well() -> None:
    T = walk(3)
    back = [Edge(k + 1, k, se3.inverse(T[k + 1]) @ T[k], INFORMATION) for k in range(2)]
    np.testing.assert_allclose(chained(3, back), T, atol=1e-9)


def test_frames_that_no_edge_reaches_are_lost() -> None:
    step = Edge(0, 1, np.eye(4), INFORMATION)
    poses, segment = chain(4, [step], [0])
    assert segment.tolist() == [0, 0, LOST, LOST]
    assert np.isnan(poses[2:]).all()


def test_every_connected_run_is_a_segment_that_starts_at_its_first_root() -> None:
    edges = [Edge(1, 2, np.eye(4), INFORMATION), Edge(4, 3, np.eye(4), INFORMATION)]
    poses, segment = chain(6, edges, [0, 1, 3, 4])
    assert segment.tolist() == [0, 1, 1, 2, 2, LOST]
    for root in (0, 1, 3):
        np.testing.assert_array_equal(poses[root], np.eye(4))


def test_a_path_has_the_motion_and_the_noise_of_its_edges_together() -> None:
    # By drawing: 1000 draws tell a variance to 4.5 %, the trace of six to less; five times that.
    T = walk(4)
    rng = np.random.default_rng(0)
    (path,) = shortest_paths(steps(T, rng), [(0, 3)])
    drawn = [shortest_paths(steps(T, rng), [(0, 3)])[0].T_i_j for _ in range(1000)]
    off = se3.inverse(se3.inverse(T[0]) @ T[3]) @ np.array(drawn)
    xi = np.concatenate([[*se3.log_so3(D[:3, :3]), *D[:3, 3]] for D in off]).reshape(-1, 6)
    assert (path.i, path.j) == (0, 3)
    squared = np.einsum("ni,ij,nj->n", xi, path.information, xi)
    assert squared.mean() == pytest.approx(6, rel=0.2)


def test_of_several_paths_the_one_with_the_least_noise_counts() -> None:
    T = walk(4)
    exact = [Edge(k, k + 1, se3.inverse(T[k]) @ T[k + 1], INFORMATION) for k in range(3)]
    sure = Edge(0, 3, se3.inverse(T[0]) @ T[3], 4 * INFORMATION)
    vague = Edge(0, 3, se3.exp([0, 0, 0, 1.0, 0, 0]), INFORMATION / 100)
    (path,) = shortest_paths([*exact, vague, sure], [(0, 3)])
    np.testing.assert_allclose(path.information, sure.information)
    np.testing.assert_allclose(path.T_i_j, sure.T_i_j)


def test_pairs_that_no_path_joins_are_left_out() -> None:
    T = walk(6)
    apart = [e for e in steps(T, np.random.default_rng(0)) if e.i != 2]
    assert [(e.i, e.j) for e in shortest_paths(apart, [(0, 2), (1, 4), (3, 5)])] == [
        (0, 2),
        (3, 5),
    ]


def test_a_path_of_more_than_the_most_variance_is_left_out() -> None:
    T = walk(4)
    exact = [Edge(k, k + 1, se3.inverse(T[k]) @ T[k + 1], INFORMATION) for k in range(3)]
    (path,) = shortest_paths(exact, [(0, 3)])
    variance = float(np.trace(np.linalg.inv(path.information)))
    pairs = [(0, 3), (0, 3)]
    assert len(shortest_paths(exact, pairs, [0.99 * variance, 1.01 * variance])) == 1


def test_poses_are_propagated_along_edges_from_known_ones_which_stay() -> None:
    T = walk(4)
    edges = [Edge(k, k + 1, se3.inverse(T[k]) @ T[k + 1], INFORMATION) for k in (0, 1)]
    poses = T.copy()
    poses[[0, 2, 3]] = np.nan
    found = propagate_poses(poses, edges)
    np.testing.assert_allclose(found[:3], T[:3], atol=1e-9)
    np.testing.assert_array_equal(found[1], T[1])
    assert np.isnan(found[3]).all()


def test_every_connected_component_has_its_first_node_as_root() -> None:
    edges = [Edge(5, 2, np.eye(4), INFORMATION), Edge(2, 4, np.eye(4), INFORMATION)]
    assert component_roots(np.array([1, 2, 4, 5]), edges) == [1, 2]


def test_poses_are_off_edges_by_what_is_left_of_the_motion_between_them() -> None:
    apart = se3.make(np.eye(3), [[0.0, 0, 0], [1.0, 0, 0], [2.5, 0, 0]])
    edges = [Edge(k, k + 1, se3.make(np.eye(3), [1.0, 0, 0]), np.eye(6)) for k in range(2)]
    off = off_edges(apart, edges)
    np.testing.assert_allclose(off[:, :3, 3], [[0, 0, 0], [0.5, 0, 0]], atol=1e-12)
    assert off_edges(apart, []).shape == (0, 4, 4)
