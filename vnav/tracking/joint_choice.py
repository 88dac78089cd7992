"""Motions of frames that follow each other, chosen together.

A frame is tracked when nothing is known of those after it. Where things repeat themselves, pixels
may leave two of its motions open, and the one taken makes the next that goes on as likely. What
comes after tells: a track that slid by a book has to stop. Source: Viterbi 1967, "Error bounds for
convolutional codes and an asymptotically optimum decoding algorithm".
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import Edge
from vnav.registration.judge import CLEAR
from vnav.tracking.motion import PastStep
from vnav.tracking.pose_choice import Rivals


@dataclass(frozen=True)
class _RivalStep:
    """A frame by its row, its motions from the frame before, and how long these took."""

    row: int
    rivals: Rivals
    took_s: float


def chosen_together(
    rivals: Mapping[int, Rivals | None],
    edges: Mapping[int, list[Edge]],
    alternatives: Mapping[int, list[Edge]],
    stamps_s: Array,
) -> tuple[dict[int, list[Edge]], dict[int, list[Edge]]]:
    """Edges and alternatives to frames, by rows, with those that are clearly likelier together.

    ``rivals`` of each frame, the one taken first; ``stamps_s`` (N,) of all frames. What was taken
    becomes the alternative. Of other edges, none that leads past such a frame stays, but where a
    frame has no other.
    """
    found, others = dict(edges), dict(alternatives)
    for chain in _chains(rivals, stamps_s):
        for row, edge in _rechosen(chain):
            taken = [e for e in edges[row] if e.i == edge.i]
            others[row] = [replace(e, probability=1 - edge.probability) for e in taken]
            found[row] = [edge]
    changed = [row for row in edges if found[row] is not edges[row]]
    for row, kept in found.items():
        found[row] = [e for e in kept if not any(e.i < k < row for k in changed)] or kept
    return found, others


def _rechosen(chain: Sequence[_RivalStep]) -> Iterator[tuple[int, Edge]]:
    """Edges to frames, by rows, in the place of those taken, where these are far less likely.

    None where no motion follows it: nothing tells then that one was mistaken.
    """
    best = _likeliest(chain)
    for first, end in _stretches(best):
        around = slice(max(first - 1, 0), end + 1)
        log_odds = _log_score(chain[around], best[around], first == 0)
        log_odds -= _log_score(chain[around], [0] * len(best[around]), first == 0)
        if end == len(chain) or log_odds < CLEAR:
            continue
        p = 1 / (1 + float(np.exp(-log_odds)))
        for step, k in zip(chain[first:end], best[first:end], strict=True):
            chosen = step.rivals.estimates[k]
            yield step.row, Edge(step.rivals.target, step.row, chosen.T_a_b, chosen.information, p)


def _chains(rivals: Mapping[int, Rivals | None], stamps_s: Array) -> Iterator[list[_RivalStep]]:
    """Steps of frames each of which is tracked from the one before."""
    chain: list[_RivalStep] = []
    for row, of_frame in sorted(rivals.items()):
        if of_frame is None:
            continue
        target = of_frame.target
        if chain and chain[-1].row != target:
            yield chain
            chain = []
        chain.append(_RivalStep(row, of_frame, float(stamps_s[row] - stamps_s[target])))
    if chain:
        yield chain


def _likeliest(chain: Sequence[_RivalStep]) -> list[int]:
    """Which of its rivals each step takes on the likeliest way through all."""
    score, before = chain[0].rivals.log_odds, list[Array]()
    for last, step in pairwise(chain):
        to = _log_going_on(last, step) + score
        before.append(to.argmax(1))
        score = to.max(1) + step.rivals.log_odds
    path = [int(score.argmax())]
    for came_from in reversed(before):
        path.append(int(came_from[path[-1]]))
    return path[::-1]


def _log_going_on(last: _RivalStep, step: _RivalStep) -> Array:
    """How likely each rival of a step (C,) goes on as each of the last (B,): logarithms (C, B)."""
    pasts = [PastStep(np.eye(4), e.T_a_b, last.took_s, 0.0, 1.0) for e in last.rivals.estimates]
    likely = [
        [
            past.goes_on(se3.inverse(past.onward(step.took_s)) @ e.T_a_b, step.took_s)
            for past in pasts
        ]
        for e in step.rivals.estimates
    ]
    return np.log(likely)


def _stretches(path: Sequence[int]) -> Iterator[tuple[int, int]]:
    """First and end of each stretch that does not take the first rivals."""
    edges = np.flatnonzero(np.diff([0, *(k > 0 for k in path), 0]))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)


def _log_score(chain: Sequence[_RivalStep], path: Sequence[int], begins: bool) -> float:
    """Of the steps of a chain after the first, and of the first if it ``begins`` one."""
    score = float(chain[0].rivals.log_odds[path[0]]) if begins else 0.0
    for (last, step), (b, c) in zip(pairwise(chain), pairwise(path), strict=True):
        score += float(step.rivals.log_odds[c] + _log_going_on(last, step)[c, b])
    return score
