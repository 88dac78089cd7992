"""Candidates among a few keyframes whose overlap is chosen."""

import numpy as np

from vnav.config import LoopsConfig
from vnav.loop_closing.loop_candidates import by_proximity

CONFIG = LoopsConfig(proximity_overlap=0.5, proximity_candidates=2)


def test_pairs_that_overlap_enough_are_candidates_once() -> None:
    overlap = np.array([[0, 0.9, 0.4], [0.9, 0, 0.6], [0.4, 0.6, 0]])
    found = by_proximity(overlap, CONFIG, set())
    assert [(c.i, c.j, c.source, c.score) for c in found] == [
        (0, 1, "proximity", 0.9),
        (1, 2, "proximity", 0.6),
    ]


def test_pairs_that_have_a_verdict_are_no_candidates_again() -> None:
    overlap = np.array([[0, 0.9], [0.9, 0]])
    assert by_proximity(overlap, CONFIG, {(0, 1)}) == []


def test_a_keyframe_proposes_those_it_overlaps_with_most() -> None:
    overlap = np.zeros((5, 5))
    overlap[0, 1:] = overlap[1:, 0] = [0.6, 0.7, 0.8, 0.9]
    few = LoopsConfig(proximity_overlap=0.5, proximity_candidates=1)
    alone = overlap.copy()
    alone[1:, 0] = 0  # only the first keyframe proposes
    assert [(c.i, c.j) for c in by_proximity(alone, few, set())] == [(0, 4)]
