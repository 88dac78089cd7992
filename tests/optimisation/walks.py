"""Odometry of a walk in a circle: every fourth frame is a keyframe, and noise is as edges say."""

from collections.abc import Sequence

import numpy as np

from vnav.core.frame import Edge, Features
from vnav.core.graph import chain
from vnav.core.mapping import FrameFeatures, FrameTable, Odometry
from vnav.features.sift import SPACE
from vnav.optimisation.second_look import Correction
from vnav.synthetic.circle import edge

EVERY = 4


def walked(T: np.ndarray, seed: int = 0) -> Odometry:
    """What odometry would make of a walk."""
    rng, count = np.random.default_rng(seed), len(T)
    pairs = []
    for j in range(1, count):
        keyframe = (j - 1) // EVERY * EVERY
        pairs += [(i, j) for i in sorted({keyframe, j - 1})]
    return of_edges([edge(T, i, j, rng) for i, j in pairs], count)


def of_edges(edges: Sequence[Edge], count: int) -> Odometry:
    empty = np.zeros((0, 1), np.float32)
    none = Features(empty.reshape(0, 2), SPACE.none(), *[empty[:, 0]] * 3, SPACE)
    keyframes = tuple(FrameFeatures(r, none, empty.reshape(0, 3)) for r in range(0, count, EVERY))
    poses, segment = chain(count, edges, [k.row for k in keyframes])
    table = FrameTable(np.zeros(count), np.arange(count), np.arange(count) / 30)
    return Odometry(table, poses, segment, ("",) * count, tuple(edges), keyframes)


class FixedLook:
    """A second look that always finds the same."""

    def __init__(self, edge: Edge | None) -> None:
        self.edge = edge
        self.asked = 0

    def correct(self, stretch, T_i_j):  # type: ignore[no-untyped-def]
        self.asked += 1
        return None if self.edge is None else Correction(stretch, self.edge)

    def log_odds_across(self, places: Sequence[np.ndarray], *_: object) -> np.ndarray:
        return np.zeros((len(places), len(places)))
