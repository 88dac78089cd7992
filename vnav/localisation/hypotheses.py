"""Poses that may be right: found in places that match, verified by what the map predicts there."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vnav.localisation.covisibility import clusters
from vnav.localisation.evidence import Evidence, counted, evidence
from vnav.localisation.guided import hits, matched, predict, reprojected
from vnav.localisation.matches import Matches
from vnav.localisation.query import Query
from vnav.localisation.ransac import Consensus, Terms, agree
from vnav.localisation.refine import refine
from vnav.localisation.search import completed
from vnav.localisation.view import View

LEAST = 5  # matches that a pose can be tried with
ATTEMPTS = 2  # poses sought in one place: repeated things in one view give several
RIVAL_SHARE = 0.2  # of the most matches that agree; a place with fewer is no rival
GUIDED_RADII = 3.0, 2.0  # one after the other, in thresholds of agreement
WIDE_RADIUS = 25.0  # about a pose that few matches hold, in the same


@dataclass(frozen=True)
class Hypothesis:
    """A pose that may be right: what agrees with it, and how strongly (see `evidence`).

    ``covariance`` (6, 6), or (7, 7) with the log focal length, of ``T_world_camera``'s tangent;
    ``cells`` (2, C): landmarks found and predicted in each cell of the image.
    """

    view: View
    covariance: NDArray[np.float64]
    matches: Matches
    cells: NDArray[np.intp]

    @cached_property
    def evidence(self) -> Evidence:
        """How much speaks for the pose."""
        return evidence(self.cells)

    @property
    def strength(self) -> float:
        """How much (nats) it speaks for the pose rather than for a rival."""
        return self.evidence.strength

    @property
    def inliers(self) -> int:
        """Number of matches that agree."""
        return len(self.matches)


def pursue(
    found: Matches, known: list[Hypothesis], query: Query, rng: np.random.Generator
) -> list[Hypothesis]:
    """The known hypotheses and those of the clusters that the matches form, the strongest first.

    Every cluster has its own poses (claim 4, 2.10), so that a rival is not lost in the crowd; one
    whose matches agree with poses that are known already tells of no other, and one that can only
    muster a small part of the most matches is left.
    """
    views = [h.view for h in known]
    most = max((h.inliers for h in known), default=0)
    agreed: list[Consensus] = []
    for cluster in clusters(found, query.database.index, query.config.max_clusters, _least(most)):
        if len(query.unexplained(cluster.matches, views)) < LEAST:
            continue
        matches = completed(cluster.matches, query)
        for _ in range(ATTEMPTS):
            matches = query.unexplained(matches, views)
            consensus = _consensus(matches, _least(most), query, rng)
            if consensus is None:
                break
            agreed.append(consensus)
            views.append(consensus.view)
            most = max(most, consensus.size)
    verified = [_settled(c.view, query, rng) for c in agreed if c.size >= _least(most)]
    return sorted([*known, *(h for h in verified if h)], key=lambda h: -h.strength)


def _least(most: int) -> int:
    return max(LEAST, int(RIVAL_SHARE * most))


def _consensus(
    matches: Matches, least: int, query: Query, rng: np.random.Generator
) -> Consensus | None:
    """A pose that ``least`` of the matches agree with, None where there is none."""
    config = query.config
    terms = Terms(query.near_px, least, config.ransac_iterations, config.solver)
    return agree(query.photo.lens, query.sightings(matches), terms, rng)


def _settled(view: View, query: Query, rng: np.random.Generator) -> Hypothesis | None:
    """The verified pose; where few matches hold it, the better one of those near it.

    Few matches of things that repeat themselves can agree on a pose beside the right one, and
    guided matching then only finds what agrees with that. All that the map predicts is sought once
    more in a wide circle, and a pose sought anew in what is found.
    """
    first = _verified(view, query)
    if first is None or first.inliers >= query.config.enough_matches:
        return first
    prediction = predict(first.view, query.database)
    around = hits(prediction, query.photo, query.database, WIDE_RADIUS * query.near_px)
    consensus = _consensus(matched(around, prediction, query.database), LEAST, query, rng)
    second = _verified(consensus.view, query) if consensus else None
    return second if second and second.strength > first.strength else first


def _verified(view: View, query: Query) -> Hypothesis | None:
    """The pose after guided matching of what the map predicts, None where that finds too little."""
    photo, database = query.photo, query.database
    prediction = predict(view, database)
    for k, radius in enumerate(GUIDED_RADII):
        if k > 0:
            prediction = reprojected(prediction.rows, view, database)
        found = hits(prediction, photo, database, radius * query.near_px)
        matches = matched(found, prediction, database)
        if len(matches) < query.config.min_inliers:
            return None
        refined = refine(view, query.sightings(matches, view), photo.lens)
        view = refined.view
    return Hypothesis(view, refined.covariance, matches, counted(prediction, found, photo))
