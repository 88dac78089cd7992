"""The last room of locating: which pose is given, or why none is."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import Rejected
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

Ranked = tuple[tuple[VerifiedPose, ...], tuple[float, ...]]  # places, probabilities


@dataclass(frozen=True)
class Located:
    """The answer, every hypothesis with the answer first, and how many matches the search found.

    ``chances``: probability of each hypothesis' place; ``confidence``: that the pose is within
    25 cm and 10 degrees. ``prior``: of the photos before, where no pose is given without it.
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
    places = _distinct_places([pose for pose in poses if pose.inliers >= min_matches(poses)])
    places, chances = _weighed(places, query, prior)
    inliers = places[0].inliers if places else 0
    least = 0.0 if prior is None else HELD_INLIERS * query.config.min_inliers
    unlikely = sum(chances) < wanted and not confirmed(places, query)
    if unlikely or inliers < least:
        return NotLocated("no consistent pose", matches, inliers, places, chances)
    ranked = _by_pixels(places, chances, query) if prior is None else (places, chances)
    return _given(ranked, matches, query, prior)


def _given(
    ranked: Ranked, matches: int, query: Query, prior: PlacePrior | None
) -> Located | NotLocated:
    """The likeliest place, if it is likely and exact enough."""
    places, chances = ranked
    wanted, inliers = query.config.min_confidence, places[0].inliers
    if chances[0] < wanted:
        return NotLocated("ambiguous", matches, inliers, places, chances)
    error = sigmas(places[0], query.database.index)
    confidence = chances[0] * error.within(NEAR_M, NEAR_RAD)
    if confidence < wanted:
        reason = f"the pose is too uncertain: {error}"
        return NotLocated(reason, matches, inliers, places, chances)
    return Located(places[0], places, chances, matches, error, confidence, prior)


def _weighed(places: Sequence[VerifiedPose], query: Query, prior: PlacePrior | None) -> Ranked:
    """Places with their probabilities, the likeliest first."""
    odds = support(places)
    if prior is not None:
        odds = odds * prior.odds([place.view for place in places], query.database.index)
    return _sorted(places, posterior([place.evidence for place in places], odds))


def _sorted(places: Sequence[VerifiedPose], chances: Array) -> Ranked:
    """Places and their probabilities, the likeliest first: the strongest need not be."""
    order = np.argsort(-chances, kind="stable")
    return tuple(places[k] for k in order), tuple(chances[order].tolist())


def _by_pixels(
    places: tuple[VerifiedPose, ...], chances: tuple[float, ...], query: Query
) -> Ranked:
    """The same places, told apart by all pixels where none is likely enough by its features."""
    is_likely = chances[0] >= query.config.min_confidence
    if is_likely or len(places) == 1 or query.pixels is None:
        return places, chances
    return _sorted(places, compared(places, chances, query.database.index, query.pixels))


def support(places: Sequence[SupportedPose]) -> Array:
    """How likely places (P,) are by the matches that agree, over the place with the most.

    A rival explains what repeats itself; the right place explains the rest of the photo, too.
    """
    inliers = np.array([place.inliers for place in places], float)
    return np.asarray((inliers / inliers.max(initial=1)) ** SUPPORT)


def _distinct_places(poses: Sequence[VerifiedPose]) -> tuple[VerifiedPose, ...]:
    """The strongest pose of each place, the strongest first."""
    places: list[VerifiedPose] = []
    for pose in sorted(poses, key=lambda pose: -pose.evidence.strength):
        if not any(_is_same_place(pose.view, place.view) for place in places):
            places.append(pose)
    return tuple(places)


def _is_same_place(a: View, b: View) -> bool:
    T = se3.inverse(a.T_world_camera) @ b.T_world_camera
    near = np.linalg.norm(T[:3, 3]) < NEAR_M
    return bool(near and se3.rotation_angle(T) < NEAR_RAD)
