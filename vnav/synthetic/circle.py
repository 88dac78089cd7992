"""A walk in a circle whose poses and edges are exact, or noisy as registration's are."""

import numpy as np

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import Edge

SIGMAS = np.array([0.002, 0.002, 0.002, 0.005, 0.005, 0.005])  # rad, m: of a good registration
INFORMATION = np.diag(SIGMAS**-2)
LAP = 40  # frames in a circle


def walk(count: int) -> Array:
    """Poses (N, 4, 4) on a circle of 2 m, looking along it; every LAP frames one comes back."""
    angle = 2 * np.pi * np.arange(count) / LAP
    position = np.stack([2 * np.cos(angle), 2 * np.sin(angle), 0 * angle], 1)
    T = se3.make(se3.exp_so3(np.outer(angle, [0, 0, 1])), position)
    return np.asarray(se3.inverse(T[0]) @ T)


def edge(T: Array, i: int, j: int, rng: np.random.Generator) -> Edge:
    """What registration would measure between frames i and j."""
    noise = se3.exp(SIGMAS * rng.standard_normal(6))
    return Edge(i, j, se3.inverse(T[i]) @ T[j] @ noise, INFORMATION)


def steps(T: Array, rng: np.random.Generator) -> list[Edge]:
    """The edges between neighbours."""
    return [edge(T, k, k + 1, rng) for k in range(len(T) - 1)]
