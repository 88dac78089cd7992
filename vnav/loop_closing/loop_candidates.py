"""Pairs of keyframes that may see the same place: by appearance, by nearness of their poses."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.config import LoopsConfig
from vnav.core.mapping import Odometry
from vnav.core.tree import VocabularyTree
from vnav.core.view_overlap import are_apart
from vnav.features.appearance import tfidf_similarity


@dataclass(frozen=True)
class LoopCandidate:
    """Keyframes i < j by number; ``source`` and ``score`` as in `LoopVerdict`."""

    i: int
    j: int
    source: str
    score: float


def by_appearance(
    odometry: Odometry, tree: VocabularyTree, config: LoopsConfig
) -> list[LoopCandidate]:
    """For each keyframe the most similar earlier ones by TF-IDF, and the two ends of the capture.

    A candidate needs a share of the similarity that neighbouring keyframes have (Galvez-Lopez,
    Tardos 2012), and must be farther away in time than ``exclude_s`` or in another segment.
    """
    similarity = tfidf_similarity(odometry.keyframes, tree)
    apart = are_apart(odometry, config.exclude_s)
    found: dict[tuple[int, int], LoopCandidate] = {}
    for j in range(1, len(similarity)):
        scores = np.where(apart[j, :j], similarity[j, :j], 0.0)
        least = max(config.min_relative_score * similarity[j, j - 1], 0.0)
        for i in np.argsort(-scores, kind="stable")[: config.candidates].tolist():
            if scores[i] > least:
                found[i, j] = LoopCandidate(i, j, "appearance", float(scores[i]))
    last = len(similarity) - 1
    if last > 0 and apart[0, last]:
        ends = LoopCandidate(0, last, "ends", float(similarity[0, last]))
        found.setdefault((0, last), ends)
    return list(found.values())


def by_proximity(
    overlap: NDArray[np.float32], config: LoopsConfig, tried: set[tuple[int, int]]
) -> list[LoopCandidate]:
    """Pairs of keyframes that should see the same by their poses and were not tried yet.

    ``overlap`` (K, K): see `core.view_overlap`.
    """
    found: dict[tuple[int, int], LoopCandidate] = {}
    for j in range(len(overlap)):
        for i in np.argsort(-overlap[j], kind="stable")[: config.proximity_candidates].tolist():
            pair = min(i, j), max(i, j)
            if overlap[j, i] >= config.proximity_overlap and pair not in tried:
                found[pair] = LoopCandidate(*pair, "proximity", float(overlap[j, i]))
    return [found[pair] for pair in sorted(found)]
