"""The second room of locating: poses that candidates' matches agree on (claim 4, 2.10)."""

from collections.abc import Sequence

import numpy as np

from vnav.localisation.hypotheses.ransac import (
    PoseHypothesis,
    RansacOptions,
    estimate_absolute_pose,
)
from vnav.localisation.matches import Matches
from vnav.localisation.query import MIN_MATCHES, Query, SupportedPose, min_matches
from vnav.localisation.search.candidates import Candidate
from vnav.localisation.view import View

ATTEMPTS = 6  # poses sought in one candidate: repeated things give several, chance some more


def hypothesise(
    candidates: Sequence[Candidate],
    known: Sequence[SupportedPose],
    query: Query,
    rng: np.random.Generator,
) -> list[View]:
    """The views of all candidates, beside those that are known.

    Every candidate has its own poses, so that a rival is not lost in the crowd; one whose matches
    agree with poses that are found already tells of no other, and a pose with only a small part of
    the most matches that agree is left.
    """
    found: list[PoseHypothesis] = []
    for candidate in candidates:
        found += _poses_of(candidate, [*known, *found], query, rng)
    enough = min_matches([*known, *found])
    return [hypothesis.view for hypothesis in found if hypothesis.inliers >= enough]


def pose_of(
    matches: Matches, min_inliers: int, query: Query, rng: np.random.Generator
) -> PoseHypothesis | None:
    """A pose that so many of the matches agree with, None where there is none."""
    config = query.config
    options = RansacOptions(
        query.inlier_threshold_px, min_inliers, config.ransac_iterations, config.solver
    )
    return estimate_absolute_pose(query.correspondences(matches), query.photo.camera, options, rng)


def _poses_of(
    candidate: Candidate, known: Sequence[SupportedPose], query: Query, rng: np.random.Generator
) -> list[PoseHypothesis]:
    """Poses that the known ones do not explain.

    One that many matches agree with explains these; one that few agree with may be chance, and
    would take matches away from the right one.
    """
    found: list[PoseHypothesis] = []
    matches, enough = query.unexplained(candidate.matches, known), query.config.min_inliers
    if len(query.unexplained(candidate.seeds, known)) < MIN_MATCHES:
        return found
    for _ in range(ATTEMPTS):
        hypothesis = pose_of(matches, min_matches([*known, *found]), query, rng)
        if hypothesis is None:
            break
        found.append(hypothesis)
        if hypothesis.inliers >= enough:
            matches = query.unexplained(matches, [hypothesis])
    return found
