"""The pose graph: trusted edges, closures that may be wrong, one robust optimum; claim 3, S7."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress
from typing import Any

import gtsam
import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import Edge
from vnav.core.graph import component_roots
from vnav.errors import VnavError

INLIER_PROBABILITY = 0.9999  # of a right closure to pass the chi-squared test
MAX_COST = float(gammaincinv(3, INLIER_PROBABILITY))  # half of chi-squared, 6 degrees of freedom
INLIER_SIGMAS = float(np.sqrt(2 * MAX_COST / 6))  # of one degree of freedom, for that cost
STEP_CONVERGED = 1e-3  # relative decrease of the error within a step of GNC; a last fit is exact
ROOT_SIGMA = 1e-4  # rad, m


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
    rejection of any that is still more than ``max_sigmas`` off, then a least-squares fit, again
    with all that agree with it: among many wrong closures, right ones are lost on the way. Where
    some are rejected, those that the ``initial`` poses bear out are fitted, too, and what costs
    less counts: right ones that differ by more than their noise may lose to a wrong one that is
    alone. ``initial`` (N, 4, 4) may hold NaN for frames that no edge names. Deterministic.
    """
    nodes = np.flatnonzero(np.isfinite(initial[:, 0, 0]))
    values, limit = _values(initial, nodes), min(max_sigmas, INLIER_SIGMAS)
    if not closures:
        return _settled(initial, edges, closures, values, np.zeros(0, bool), limit)
    graph = _graph(initial, nodes, [*edges, *closures])
    robust, kept = _graduated_non_convexity(graph, values, len(closures))
    kept &= _sigmas(robust, closures) <= max_sigmas
    found = [_settled(initial, edges, closures, robust, kept, limit)]
    if not kept.all():
        kept = _sigmas(values, closures) <= max_sigmas
        found.append(_settled(initial, edges, closures, values, kept, limit))
    return min(found, key=lambda graph: _truncated_cost(graph, max_sigmas))


def _settled(
    initial: Array,
    edges: Sequence[Edge],
    closures: Sequence[Edge],
    values: Any,
    kept: NDArray[np.bool_],
    limit: float,
) -> PoseGraph:
    """The least-squares fit of edges and kept closures, again with all that agree with it."""
    nodes = np.flatnonzero(np.isfinite(initial[:, 0, 0]))
    while True:
        graph = _graph(initial, nodes, [*edges, *compress(closures, kept)])
        before = graph.error(_values(initial, nodes))
        values = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
        sigmas = _sigmas(values, closures)
        agree = kept | (sigmas <= limit)
        if (agree == kept).all():
            return PoseGraph(_poses(values, initial), kept, sigmas, before, graph.error(values))
        kept = agree


def _truncated_cost(graph: PoseGraph, max_sigmas: float) -> float:
    """Truncated least squares: what is rejected costs as much as the worst that may be kept."""
    return graph.error_after + 3 * max_sigmas**2 * int((~graph.kept).sum())


def check_closures(T_world_camera: Array, closures: Sequence[Edge], max_sigmas: float) -> PoseGraph:
    """Poses (N, 4, 4) as they are, and those closures that are no more than ``max_sigmas`` off."""
    values = _values(T_world_camera, np.flatnonzero(np.isfinite(T_world_camera[:, 0, 0])))
    sigmas = _sigmas(values, closures)
    return PoseGraph(T_world_camera, sigmas <= max_sigmas, sigmas, 0.0, 0.0)


def fit(initial: Array, edges: Sequence[Edge]) -> Array:
    """The poses (N, 4, 4) that fit edges best, all of which are trusted."""
    return optimise(initial, edges, (), 0.0).T_world_camera


def optimise_others(poses: Array, edges: Sequence[Edge], fixed: NDArray[np.intp]) -> Array:
    """Poses (N, 4, 4) of all frames by their edges, where those of the rows ``fixed`` are final."""
    graph = gtsam.NonlinearFactorGraph()
    for n in fixed:
        graph.add(gtsam.NonlinearEqualityPose3(int(n), gtsam.Pose3(poses[n])))
    for e in edges:
        graph.add(_between(e))
    values = _values(poses, np.flatnonzero(np.isfinite(poses[:, 0, 0])))
    return _poses(gtsam.LevenbergMarquardtOptimizer(graph, values).optimize(), poses)


def self_test() -> None:
    """Raise VnavError where gtsam does not close a square of four poses against one wrong loop."""
    step = se3.make(se3.exp_so3([0, 0, np.pi / 2]), [1.0, 0, 0])
    edges = [Edge(k, k + 1, step, np.eye(6) * 100) for k in range(3)]
    closures = [Edge(3, 0, step, np.eye(6) * 100), Edge(0, 2, np.eye(4), np.eye(6) * 100)]
    initial = np.stack([np.linalg.matrix_power(step, k) for k in range(4)])
    result = optimise(initial, edges, closures, 6.0)
    if result.kept.tolist() != [True, False] or result.error_after > 1e-9:
        raise VnavError("expected gtsam to refuse a wrong loop, it did not; reinstall gtsam")


def _graduated_non_convexity(
    graph: Any, values: Any, closures: int
) -> tuple[Any, NDArray[np.bool_]]:
    """The robust optimum, and which of the last factors, the ``closures``, are its inliers."""
    step = gtsam.LevenbergMarquardtParams()
    step.setRelativeErrorTol(STEP_CONVERGED)
    params = gtsam.GncLMParams(step)
    params.setScheduler(gtsam.GncScheduler.SuperLinear)  # the other stops too early
    params.setLossType(gtsam.GncLossType.TLS)
    params.setKnownInliers(list(range(graph.size() - closures)))
    optimizer = gtsam.GncLMOptimizer(graph, values, params)
    optimizer.setInlierCostThresholdsAtProbability(INLIER_PROBABILITY)
    result = optimizer.optimize()
    return result, np.asarray(optimizer.getWeights())[-closures:] > 0.5


def _graph(initial: Array, nodes: NDArray[np.intp], edges: Sequence[Edge]) -> Any:
    """Edges, after one prior for the first node of each connected component."""
    graph = gtsam.NonlinearFactorGraph()
    tight = gtsam.noiseModel.Isotropic.Sigma(6, ROOT_SIGMA)
    for n in component_roots(nodes, edges):
        graph.add(gtsam.PriorFactorPose3(n, gtsam.Pose3(initial[n]), tight))
    for e in edges:
        graph.add(_between(e))
    return graph


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


def _sigmas(values: Any, edges: Sequence[Edge]) -> Array:
    """Residual (E,) of each edge in standard deviations of one degree of freedom."""
    return np.array([_residual_sigmas(values, e) for e in edges])


def _residual_sigmas(values: Any, e: Edge) -> float:
    T_i_j = values.atPose3(e.i).between(values.atPose3(e.j)).matrix()
    xi = gtsam.Pose3.Logmap(gtsam.Pose3(se3.inverse(e.T_i_j) @ T_i_j))
    return float(np.sqrt(xi @ e.information @ xi / 6))
