"""The last room of locating: which pose is given, or why none is."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import Rejected
from vnav.localisation.hypotheses.pose_refinement import either
from vnav.localisation.prior import PlacePrior
from vnav.localisation.query import Query, SupportedPose, min_matches
from vnav.localisation.search.candidates import SearchResult
from vnav.localisation.verdict.comparison import compared
from vnav.localisation.verdict.uncertainty import Sigmas, sigmas
from vnav.localisation.verification.evidence import posterior
from vnav.localisation.verification.verify import VerifiedPose, confirmed
from vnav.localisation.view import View

SUPPORT = 2.0  # exponent of the matches that agree: how much likelier they make a place
HELD_INLIERS = 2.0  # of a pose that only the photos before hold, over `locate.min_inliers`
NEAR_M, NEAR_RAD = 0.25, np.deg2rad(10.0)  # what counts as the same place
SAME_SEEN = 2.0  # inlier thresholds: two poses see the same things no farther apart than that

Ranked = tuple[tuple[VerifiedPose, ...], tuple[float, ...]]  # poses, probabilities


@dataclass(frozen=True)
class Located:
    """The answer, every hypothesis with the answer first, and how many matches the search found.

    ``chances``: probability of each hypothesis; ``confidence``: that the pose is within 25 cm and
    10 degrees. ``prior``: of the photos before, where no pose is given without it.
    """

    best: VerifiedPose
    hypotheses: tuple[VerifiedPose, ...]
    chances: tuple[float, ...]
    matches: int
    sigmas: Sigmas
    confidence: float
    prior: PlacePrior | None = None

    @property
    def inliers(self) -> int:
        """Number of matches that agree with the answer."""
        return self.best.inliers


@dataclass(frozen=True)
class NotLocated(Rejected):
    """Why the photo was not located; hypotheses that were not good enough, and their chances."""

    hypotheses: tuple[VerifiedPose, ...] = ()
    chances: tuple[float, ...] = ()


def decide(
    poses: Sequence[VerifiedPose],
    searched: SearchResult,
    query: Query,
    prior: PlacePrior | None = None,
) -> Located | NotLocated:
    """The best pose, if the photo was taken there as good as surely, and how exact it is.

    A prior of the photos before is asked only where the photo alone has no answer.
    """
    alone = _judged(poses, searched, query, None)
    if prior is None or isinstance(alone, Located):
        return alone
    held = _judged(poses, searched, query, prior)
    return held if isinstance(held, Located) else alone


def _judged(
    poses: Sequence[VerifiedPose], searched: SearchResult, query: Query, prior: PlacePrior | None
) -> Located | NotLocated:
    """By what the photo shows, and by the prior where there is one."""
    matches, wanted = len(searched.matches), query.config.min_confidence
    if not poses and searched.votes < query.config.min_inliers:
        return NotLocated("too few matches", matches)
    found = _distinct([pose for pose in poses if pose.inliers >= min_matches(poses)], query)
    found, chances = _weighed(found, query, prior)
    inliers = found[0].inliers if found else 0
    least = 0.0 if prior is None else HELD_INLIERS * query.config.min_inliers
    unlikely = sum(chances) < wanted and not confirmed(found, query)
    if unlikely or inliers < least:
        return NotLocated("no consistent pose", matches, inliers, found, chances)
    ranked = _by_pixels(found, chances, query) if prior is None else (found, chances)
    return _given(ranked, matches, query, prior)


def _given(
    ranked: Ranked, matches: int, query: Query, prior: PlacePrior | None
) -> Located | NotLocated:
    """The likeliest pose, if its place is likely, and the pose exact enough."""
    found, chances = ranked
    wanted, inliers = query.config.min_confidence, found[0].inliers
    best, chance = _place(ranked)
    if chance < wanted:
        return NotLocated("ambiguous", matches, inliers, found, chances)
    error = sigmas(best, query.database.index)
    confidence = chance * error.within(NEAR_M, NEAR_RAD)
    if confidence < wanted:
        reason = f"the pose is too uncertain: {error}"
        return NotLocated(reason, matches, inliers, found, chances)
    return Located(found[0], found, chances, matches, error, confidence, prior)


def _place(ranked: Ranked) -> tuple[VerifiedPose, float]:
    """The likeliest pose, as uncertain as others of its place make it, and the place's chance."""
    (best, *others), (chance, *chances) = ranked
    refined = best.refined
    for other, more in zip(others, chances, strict=True):
        if more > 0 and _is_same_place(best.view, other.view):
            chance += more
            refined = either(refined, other.refined, more / chance)
    return replace(best, refined=refined), chance


def _weighed(poses: Sequence[VerifiedPose], query: Query, prior: PlacePrior | None) -> Ranked:
    """Poses with their probabilities, the likeliest first."""
    odds = support(poses)
    if prior is not None:
        odds = odds * prior.odds([pose.view for pose in poses], query.database.index)
    return _sorted(poses, posterior([pose.evidence for pose in poses], odds))


def _sorted(poses: Sequence[VerifiedPose], chances: Array) -> Ranked:
    """Poses and their probabilities, the likeliest first: the strongest need not be."""
    order = np.argsort(-chances, kind="stable")
    return tuple(poses[k] for k in order), tuple(chances[order].tolist())


def _by_pixels(poses: tuple[VerifiedPose, ...], chances: tuple[float, ...], query: Query) -> Ranked:
    """The same poses, told apart by all pixels where none is likely enough by its features."""
    is_likely = chances[0] >= query.config.min_confidence
    if is_likely or len(poses) == 1 or query.pixels is None:
        return poses, chances
    return _sorted(poses, compared(poses, chances, query.database.index, query.pixels))


def support(poses: Sequence[SupportedPose]) -> Array:
    """How likely poses (P,) are by the matches that agree, over the pose with the most.

    A rival explains what repeats itself; the right place explains the rest of the photo, too.
    """
    inliers = np.array([pose.inliers for pose in poses], float)
    return np.asarray((inliers / inliers.max(initial=1)) ** SUPPORT)


def _distinct(poses: Sequence[VerifiedPose], query: Query) -> tuple[VerifiedPose, ...]:
    """Poses that explain the photo in different ways, the strongest of each; strongest first."""
    found: list[VerifiedPose] = []
    for pose in sorted(poses, key=lambda pose: -pose.evidence.strength):
        if not any(_is_same(pose, other, query) for other in found):
            found.append(pose)
    return tuple(found)


def _is_same(pose: VerifiedPose, stronger: VerifiedPose, query: Query) -> bool:
    """Whether a pose is in a stronger one's place, and sees what matches there where that does.

    What repeats itself within a place, as books and tiles do, is seen elsewhere.
    """
    if not _is_same_place(pose.view, stronger.view):
        return False
    points = query.database.index.points_world[stronger.matches.landmark]
    px, stronger_px = (one.view.project(points)[0] for one in (pose, stronger))
    apart_px = np.linalg.norm(px - stronger_px, axis=1)
    return bool(np.median(apart_px) < SAME_SEEN * query.inlier_threshold_px)


def _is_same_place(a: View, b: View) -> bool:
    T = se3.inverse(a.T_world_camera) @ b.T_world_camera
    near = np.linalg.norm(T[:3, 3]) < NEAR_M
    return bool(near and se3.rotation_angle(T) < NEAR_RAD)
