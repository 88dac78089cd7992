"""Pose graphs as other programs read them; gtsam, which has a reader of its own, is one."""

from pathlib import Path

import gtsam
import numpy as np

from vnav.core import se3
from vnav.core.frame import Edge
from vnav.io.formats.g2o import write_g2o


def walk(count: int) -> np.ndarray:
    """Poses (N, 4, 4) that turn all about, with rotations of more than half a turn among them."""
    steps = se3.exp(np.random.default_rng(15).normal(size=(count, 6)))
    T = [np.eye(4)]
    for step in steps[1:]:
        T.append(T[-1] @ step)
    return np.array(T)


def steps(T: np.ndarray) -> list[Edge]:
    rng = np.random.default_rng(16)
    root = rng.normal(size=(len(T), 6, 6))
    information = 1e4 * (root @ np.swapaxes(root, 1, 2) + np.eye(6))
    return [Edge(k, k + 1, se3.inverse(T[k]) @ T[k + 1], information[k]) for k in range(len(T) - 1)]


def test_the_g2o_file_holds_every_pose_and_every_edge_between_them(tmp_path: Path) -> None:
    T, edges = walk(6), steps(walk(6))
    T[5] = np.nan
    write_g2o(tmp_path / "graph.g2o", T, edges)
    lines = [line.split() for line in (tmp_path / "graph.g2o").read_text().splitlines()]
    vertices = {line[1]: line[2:] for line in lines if line[0] == "VERTEX_SE3:QUAT"}
    assert sorted(vertices) == ["0", "1", "2", "3", "4"]
    np.testing.assert_allclose(np.array(vertices["3"][:3], float), T[3, :3, 3], atol=1e-4)
    pairs = [tuple(line[1:3]) for line in lines if line[0] == "EDGE_SE3:QUAT"]
    assert pairs == [("0", "1"), ("1", "2"), ("2", "3"), ("3", "4")]


def test_gtsam_reads_the_same_poses_motions_and_information(tmp_path: Path) -> None:
    T, edges = walk(40), steps(walk(40))
    write_g2o(tmp_path / "graph.g2o", T, edges)
    graph, values = gtsam.readG2o(str(tmp_path / "graph.g2o"), True)
    assert graph.size() == len(edges)
    for k, pose in enumerate(T):  # six digits a number
        np.testing.assert_allclose(values.atPose3(k).matrix(), pose, rtol=0, atol=2e-5 * 40)
    for k, e in enumerate(edges):
        factor = graph.at(k)
        np.testing.assert_allclose(factor.measured().matrix(), e.T_i_j, atol=2e-5)
        information = factor.noiseModel().information()
        np.testing.assert_allclose(information, e.information, rtol=1e-4, atol=1.0)


def test_gtsam_would_write_the_same_file(tmp_path: Path) -> None:
    T, edges = walk(40), steps(walk(40))
    write_g2o(tmp_path / "graph.g2o", T, edges)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for k, pose in enumerate(T):
        values.insert(k, gtsam.Pose3(pose))
    for e in edges:
        noise = gtsam.noiseModel.Gaussian.Information(e.information)
        graph.add(gtsam.BetweenFactorPose3(e.i, e.j, gtsam.Pose3(e.T_i_j), noise))
    gtsam.writeG2o(graph, values, str(tmp_path / "theirs.g2o"))
    ours, theirs = ((tmp_path / name).read_text() for name in ("graph.g2o", "theirs.g2o"))
    assert ours == theirs
