"""Motions of frames that follow each other, chosen together.

A frame is tracked when nothing is known of those after it. Where things repeat themselves, pixels
may leave two of its motions open, and the one taken makes the next that goes on as likely. What
comes after tells: a track that slid by a book has to stop. Source: Baum, Petrie, Soules and Weiss
1970, "A maximization technique occurring in the statistical analysis of probabilistic functions of
Markov chains": the probability of each motion given all frames, forwards and backwards.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import Edge
from vnav.tracking.motion import PastStep
from vnav.tracking.pose_choice import Rivals

SURE = 0.99  # probability by all frames, of a motion that another was taken for


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
    """Edges to frames, by rows, that are sure, in the place of those taken.

    None from which on all are others than those taken: nothing tells then that these were mistaken.
    """
    found = _probabilities(chain)
    best = np.array([p.argmax() if p.max() >= SURE else 0 for p in found])
    last_taken = int(np.flatnonzero(best == 0).max(initial=-1))
    for n in np.flatnonzero(best[: last_taken + 1]).tolist():
        step, k = chain[n], int(best[n])
        chosen, p = step.rivals.estimates[k], float(found[n][k])
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


def _probabilities(chain: Sequence[_RivalStep]) -> list[Array]:
    """Of the rivals of each step (C,), by all steps before and after it."""
    seen = [step.rivals.log_odds for step in chain]
    links = [_log_going_on(last, step) for last, step in pairwise(chain)]
    before, after = [np.zeros(len(seen[0]))], [np.zeros(len(seen[-1]))]
    for n, link in enumerate(links):
        before.append(np.logaddexp.reduce(link + before[-1] + seen[n], axis=1))
    for n, link in reversed(list(enumerate(links, 1))):
        after.append(np.logaddexp.reduce(link.T + after[-1] + seen[n], axis=1))
    logs = [np.sum(of_step, axis=0) for of_step in zip(before, seen, after[::-1], strict=True)]
    return [np.exp(log - np.logaddexp.reduce(log)) for log in logs]


def _log_going_on(last: _RivalStep, step: _RivalStep) -> Array:
    """How likely each rival of a step (C,) goes on as each of the last (B,): logarithms (C, B)."""
    pasts = [PastStep(np.eye(4), e.T_a_b, last.took_s, 0.0, 1.0) for e in last.rivals.estimates]
    motions, took_s = np.stack([e.T_a_b for e in step.rivals.estimates]), step.took_s
    likely = [past.goes_on(se3.inverse(past.onward(took_s)) @ motions, took_s) for past in pasts]
    return np.log(likely).T
