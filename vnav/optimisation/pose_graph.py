"""The pose graph: trusted edges, closures that may be wrong, one robust optimum; claim 3, S7."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np
from numpy.typing import NDArray

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import Edge
from vnav.errors import VnavError

NEAR_M, NEAR_RAD = 0.3, 0.2  # two closures that place a segment alike
AGREEING = 3  # closures between captures: one that is wrong has nothing there to contradict it
INLIER_PROBABILITY = 0.9999  # of a right closure to pass the chi-squared test
STEP_CONVERGED = 1e-3  # relative decrease of the error within a step of GNC; a last fit is exact


@dataclass(frozen=True)
class PoseGraph:
    """Optimised poses (N, 4, 4), NaN where no edge reaches, and which closures (C,) were kept.

    ``closure_sigmas`` (C,): each closure's residual at the optimum, in standard deviations.
    """

    T_world_camera: Array
    kept: NDArray[np.bool_]
    closure_sigmas: Array
    error_before: float
    error_after: float


def optimise(
    initial: Array, edges: Sequence[Edge], closures: Sequence[Edge], max_sigmas: float
) -> PoseGraph:
    """The poses that fit all trusted edges and those closures that agree with them.

    Graduated non-convexity with truncated least squares (Yang et al. 2020) over the closures, then
    rejection of any that is still more than ``max_sigmas`` off, then a last least-squares fit.
    ``initial`` (N, 4, 4) may hold NaN for frames that no edge names. Deterministic.
    """
    nodes = np.flatnonzero(np.isfinite(initial[:, 0, 0]))
    values = _values(initial, nodes)
    kept = np.ones(len(closures), bool)
    if closures:
        graph = _graph(initial, nodes, [*edges, *closures])
        values, kept = _graduated(graph, values, len(closures))
        sigmas = np.array([_sigmas(values, e) for e in closures])
        kept &= sigmas <= max_sigmas
    graph = _graph(initial, nodes, [*edges, *(e for e, k in zip(closures, kept, strict=True) if k)])
    before = graph.error(_values(initial, nodes))
    values = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    sigmas = np.array([_sigmas(values, e) for e in closures])
    return PoseGraph(_poses(values, initial), kept, sigmas, before, graph.error(values))


def held(T_world_camera: Array, closures: Sequence[Edge], max_sigmas: float) -> PoseGraph:
    """Poses (N, 4, 4) as they are, and those closures that are no more than ``max_sigmas`` off."""
    values = _values(T_world_camera, np.flatnonzero(np.isfinite(T_world_camera[:, 0, 0])))
    sigmas = np.array([_sigmas(values, e) for e in closures])
    return PoseGraph(T_world_camera, sigmas <= max_sigmas, sigmas, 0.0, 0.0)


def carry(poses: Array, edges: Sequence[Edge], held: NDArray[np.intp]) -> Array:
    """Poses (N, 4, 4) of all frames by their edges, where those of the rows ``held`` are final."""
    nodes = np.flatnonzero(np.isfinite(poses[:, 0, 0]))
    graph = gtsam.NonlinearFactorGraph()
    for n in held:
        graph.add(gtsam.NonlinearEqualityPose3(int(n), gtsam.Pose3(poses[n])))
    for e in edges:
        graph.add(_between(e))
    return _poses(gtsam.LevenbergMarquardtOptimizer(graph, _values(poses, nodes)).optimize(), poses)


def along(edges: Sequence[Edge], pairs: Sequence[tuple[int, int]]) -> list[Edge]:
    """How frames stand to later ones by the surest way along edges that go forward between them.

    Pairs that no such way joins are left out. Errors of edges add up as if they were independent.
    """
    into: dict[int, list[Edge]] = {}
    for e in edges:
        into.setdefault(e.j, []).append(e)
    ways = [(i, j, _way(into, i, j)) for i, j in pairs]
    return [Edge(i, j, w[0], np.asarray(np.linalg.inv(w[1]))) for i, j, w in ways if w is not None]


def _way(into: dict[int, list[Edge]], first: int, last: int) -> tuple[Array, Array] | None:
    """Motion and covariance (6, 6) from a frame to a later one, None where nothing joins them."""
    ways = {first: (np.eye(4), np.zeros((6, 6)))}
    for row in range(first + 1, last + 1):
        found = [_then(*ways[e.i], e) for e in into.get(row, ()) if e.i in ways]
        if found:
            ways[row] = min(found, key=lambda way: float(np.trace(way[1])))
    return ways.get(last)


def _then(T: Array, covariance: Array, e: Edge) -> tuple[Array, Array]:
    """A motion and its covariance, with an edge after it."""
    adjoint = gtsam.Pose3(se3.inverse(e.T_i_j)).AdjointMap()
    return T @ e.T_i_j, adjoint @ covariance @ adjoint.T + np.linalg.inv(e.information)


def join(
    T_segment_camera: Array,
    segment: NDArray[np.int32],
    capture: NDArray[np.int32],
    closures: Sequence[Edge],
) -> tuple[Array, NDArray[np.int32]]:
    """Poses (N, 4, 4) with segments laid beside each other by closures, and the parts (N,) left.

    Two segments are joined by the closure that most others between them agree with. One alone will
    do within a capture; between frames of different captures `AGREEING` must say the same. Frames
    of one part share a frame of reference: that of the part's first segment.
    """
    poses, part = T_segment_camera.copy(), segment.copy()
    while True:
        for (a, b), found in _between_parts(poses, part, capture, closures):
            T_a_b, votes = _consensus(found)
            if votes >= AGREEING:
                rows = part == b
                poses[rows] = T_a_b @ poses[rows]
                part[rows] = a
                break
        else:
            return poses, part


def _between_parts(
    poses: Array, part: NDArray[np.int32], capture: NDArray[np.int32], closures: Sequence[Edge]
) -> list[tuple[tuple[int, int], list[tuple[Array, Array, int]]]]:
    """Parts a < b with closures between them, those with most first.

    Of each closure: ``T_a_b``, where in b it was measured, ``T_b_camera``, and its votes.
    """
    found: dict[tuple[int, int], list[tuple[Array, Array, int]]] = {}
    for e in closures:
        a, b = int(part[e.i]), int(part[e.j])
        if a != b:
            T_a_b = poses[e.i] @ e.T_i_j @ se3.inverse(poses[e.j])
            pair, row, T = ((a, b), e.j, T_a_b) if a < b else ((b, a), e.i, se3.inverse(T_a_b))
            votes = AGREEING if capture[e.i] == capture[e.j] else 1
            found.setdefault(pair, []).append((T, poses[row], votes))
    return sorted(found.items(), key=lambda item: (len(item[1]), item[0]), reverse=True)


def _consensus(found: Sequence[tuple[Array, Array, int]]) -> tuple[Array, int]:
    """The ``T_a_b`` with most votes of those near to it where it was measured, and its votes."""
    T_a_b, T_b_camera, votes = (np.stack(column) for column in zip(*found, strict=True))
    apart = se3.inverse(T_a_b @ T_b_camera)[:, None] @ (T_a_b @ T_b_camera[:, None])
    count = is_near(apart) @ votes
    best: Array = T_a_b[count.argmax()]
    return best, int(count.max())


def is_near(apart: Array) -> NDArray[np.bool_]:
    """Whether two poses that are so far apart (..., 4, 4) are as good as the same."""
    near = np.linalg.norm(apart[..., :3, 3], axis=-1) < NEAR_M
    return np.asarray(near & (se3.rotation_angle(apart) < NEAR_RAD))


def softened(edge: Edge, sigma_rad: float, sigma_m: float) -> Edge:
    """The edge with noise added to its own: its covariance grows by the squares of the sigmas."""
    added = np.repeat([sigma_rad**2, sigma_m**2], 3)
    covariance = np.linalg.inv(edge.information) + np.diag(added)
    return Edge(edge.i, edge.j, edge.T_i_j, np.linalg.inv(covariance))


def write_g2o(path: str, T_world_camera: Array, edges: Sequence[Edge]) -> None:
    """Write poses and edges in the g2o text format (VERTEX_SE3:QUAT, EDGE_SE3:QUAT)."""
    nodes = np.flatnonzero(np.isfinite(T_world_camera[:, 0, 0]))
    inside = set(nodes.tolist())
    graph = gtsam.NonlinearFactorGraph()
    for e in edges:
        if e.i in inside and e.j in inside:
            graph.add(_between(e))
    gtsam.writeG2o(graph, _values(T_world_camera, nodes), path)


def self_test() -> None:
    """Raise VnavError where gtsam does not close a square of four poses against one wrong loop."""
    step = se3.make(se3.exp_so3([0, 0, np.pi / 2]), [1.0, 0, 0])
    edges = [Edge(k, k + 1, step, np.eye(6) * 100) for k in range(3)]
    closures = [Edge(3, 0, step, np.eye(6) * 100), Edge(0, 2, np.eye(4), np.eye(6) * 100)]
    initial = np.stack([np.linalg.matrix_power(step, k) for k in range(4)])
    result = optimise(initial, edges, closures, 6.0)
    if result.kept.tolist() != [True, False] or result.error_after > 1e-9:
        raise VnavError("expected gtsam to refuse a wrong loop, it did not; reinstall gtsam")


def _graduated(graph: Any, values: Any, closures: int) -> tuple[Any, NDArray[np.bool_]]:
    step = gtsam.LevenbergMarquardtParams()
    step.setRelativeErrorTol(STEP_CONVERGED)
    params = gtsam.GncLMParams(step)
    params.setLossType(gtsam.GncLossType.TLS)
    params.setKnownInliers(list(range(graph.size() - closures)))
    optimizer = gtsam.GncLMOptimizer(graph, values, params)
    optimizer.setInlierCostThresholdsAtProbability(INLIER_PROBABILITY)
    result = optimizer.optimize()
    return result, np.asarray(optimizer.getWeights())[-closures:] > 0.5


def _graph(initial: Array, nodes: NDArray[np.intp], edges: Sequence[Edge]) -> Any:
    """Edges, after one prior for the first node of each connected part."""
    graph = gtsam.NonlinearFactorGraph()
    tight = gtsam.noiseModel.Isotropic.Sigma(6, 1e-4)
    for n in _first_nodes(nodes, edges):
        graph.add(gtsam.PriorFactorPose3(int(n), gtsam.Pose3(initial[n]), tight))
    for e in edges:
        graph.add(_between(e))
    return graph


def _first_nodes(nodes: NDArray[np.intp], edges: Sequence[Edge]) -> list[int]:
    parent = {int(n): int(n) for n in nodes}

    def root(n: int) -> int:
        while parent[n] != n:
            parent[n] = n = parent[parent[n]]
        return n

    for e in edges:
        a, b = sorted((root(e.i), root(e.j)))
        parent[b] = a
    return sorted({root(int(n)) for n in nodes})


def _between(e: Edge) -> Any:
    noise = gtsam.noiseModel.Gaussian.Information(e.information)
    return gtsam.BetweenFactorPose3(e.i, e.j, gtsam.Pose3(e.T_i_j), noise)


def _values(poses: Array, nodes: NDArray[np.intp]) -> Any:
    values = gtsam.Values()
    for n in nodes:
        values.insert(int(n), gtsam.Pose3(poses[n]))
    return values


def _poses(values: Any, like: Array) -> Array:
    poses = np.full_like(like, np.nan)
    for n in np.flatnonzero(np.isfinite(like[:, 0, 0])):
        poses[n] = values.atPose3(int(n)).matrix()
    return poses


def _sigmas(values: Any, e: Edge) -> float:
    """Residual of an edge in standard deviations of one degree of freedom."""
    T_i_j = values.atPose3(e.i).between(values.atPose3(e.j)).matrix()
    xi = gtsam.Pose3.Logmap(gtsam.Pose3(se3.inverse(e.T_i_j) @ T_i_j))
    return float(np.sqrt(xi @ e.information @ xi / 6))
