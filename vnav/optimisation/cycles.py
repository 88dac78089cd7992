"""Odometry's edges held against each other: two edges into one frame make a cycle."""

from collections import defaultdict
from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import Edge

WRONG_RAD, WRONG_M = np.deg2rad(1.0), 0.03  # what is off by less does no harm
TAIL, TAIL_SIGMAS = 0.75, 1.143  # quantile of the root of chi-squared / 6, 6 degrees of freedom


def suspects(edges: Sequence[Edge], max_sigmas: float) -> NDArray[np.bool_]:
    """Which edges (E,) are in a cycle that does not close: one of its edges is wrong.

    Such a cycle is more than ``max_sigmas`` standard deviations off, and more than `WRONG_M` or
    `WRONG_RAD`. An edge that is in no cycle is no suspect.
    """
    cycles = _cycles(edges)
    motion, sigmas = _closing_errors(edges, cycles)
    broken = (sigmas > max_sigmas * _noise_factor(sigmas)) & are_wrong(motion)
    found = np.zeros(len(edges) + 1, bool)
    found[cycles[broken]] = True
    return found[:-1]


def noise_factor(edges: Sequence[Edge]) -> float:
    """How many times as far as they say edges are off, as their cycles show; at least 1.

    Frames that are blurred or read out line by line all err alike.
    """
    return _noise_factor(_closing_errors(edges, _cycles(edges))[1])


def are_wrong(motion: Array) -> NDArray[np.bool_]:
    """Whether motions (..., 4, 4) that should be none are more than `WRONG_M` or `WRONG_RAD`."""
    far = np.linalg.norm(motion[..., :3, 3], axis=-1) > WRONG_M
    return np.asarray(far | (se3.rotation_angle(motion) > WRONG_RAD))


def _noise_factor(sigmas: Array) -> float:
    """By a quantile that the few wrong edges do not reach."""
    return max(1.0, float(np.quantile(sigmas, TAIL)) / TAIL_SIGMAS) if len(sigmas) else 1.0


def _cycles(edges: Sequence[Edge]) -> NDArray[np.intp]:
    """Numbers (C, 3) of the edges i to k, k to j, i to j; -1 for the second where i is k."""
    between, into = defaultdict(list), defaultdict(list)
    for n, e in enumerate(edges):
        between[e.i, e.j].append(n)
        into[e.j].append(n)
    found = []
    for incoming in into.values():
        for a, b in combinations(sorted(incoming, key=lambda n: edges[n].i), 2):
            i, k = edges[a].i, edges[b].i
            found += [(b, -1, a)] if i == k else [(n, b, a) for n in between[i, k]]
    return np.array(found, np.intp).reshape(-1, 3)


def _closing_errors(edges: Sequence[Edge], cycles: NDArray[np.intp]) -> tuple[Array, Array]:
    """The motion (C, 4, 4) around each cycle, which should be none, and its size (C,).

    The size is in standard deviations of one degree of freedom; covariances add up.
    """
    T = np.stack([*(e.T_i_j for e in edges), np.eye(4)])
    information = np.stack([*(e.information for e in edges), np.eye(6)])
    covariance = np.linalg.inv(information)
    covariance[-1] = 0.0
    first, second, direct = cycles.T
    motion = se3.inverse(T[direct]) @ T[first] @ T[second]
    turned = se3.adjoint(se3.inverse(T[second]))
    spread = turned @ covariance[first] @ np.swapaxes(turned, -1, -2)
    spread = spread + covariance[second] + covariance[direct]
    off = se3.deviation(motion)
    squared = np.einsum("ci,ci->c", off, np.linalg.solve(spread, off[..., None])[..., 0])
    return motion, np.sqrt(squared / 6)
