"""Finding a photo in a map: search, poses, and the verdict (claim 4)."""

from dataclasses import dataclass

import numpy as np

from vnav.core import se3
from vnav.core.frame import Rejected
from vnav.localisation.covisibility import fullness
from vnav.localisation.evidence import posterior
from vnav.localisation.hypotheses import Hypothesis, pursue
from vnav.localisation.query import Query
from vnav.localisation.refine import Lens, refine
from vnav.localisation.search import repeated_matches, seeds
from vnav.localisation.uncertainty import Sigmas, sigmas
from vnav.localisation.view import View

NEAR_M, NEAR_RAD = 0.25, np.deg2rad(10.0)  # what counts as the same place


@dataclass(frozen=True)
class Located:
    """The answer, every hypothesis with the answer first, and the matches the search had found.

    ``chances``: probability of each hypothesis' place; ``confidence``: that the pose is within
    25 cm and 10 degrees.
    """

    best: Hypothesis
    hypotheses: tuple[Hypothesis, ...]
    chances: tuple[float, ...]
    matches: int
    sigmas: Sigmas
    confidence: float

    @property
    def inliers(self) -> int:
        """Number of matches that agree with the answer."""
        return self.best.inliers


@dataclass(frozen=True)
class NotLocated(Rejected):
    """Why the photo was not located; hypotheses that were not good enough, and their chances."""

    hypotheses: tuple[Hypothesis, ...] = ()
    chances: tuple[float, ...] = ()


def localise(query: Query, rng: np.random.Generator) -> Located | NotLocated:
    """Where the photo was taken, or why that cannot be said; never a guess.

    Where a pose is found, other places that its features match as well are tried, too; where none
    is, the map may repeat itself, and everything alike is tried.
    """
    features, config = query.photo.features, query.config
    if len(features) < config.min_features:
        return NotLocated("too few features")
    found = seeds(query)
    hypotheses = pursue(found, [], query, rng)
    if hypotheses and posterior([hypotheses[0].evidence])[0] >= config.min_confidence:
        again = repeated_matches(hypotheses[0].matches.feature, query)
    else:
        again = found = repeated_matches(np.arange(len(features)), query)
    hypotheses = pursue(again, hypotheses, query, rng)
    fullest = fullness(found, query.database.index).max(initial=0)
    if not hypotheses and fullest < config.min_inliers:
        return NotLocated("too few matches", len(found))
    return _verdict(hypotheses, len(found), query)


def own_focal(hypothesis: Hypothesis, query: Query) -> tuple[float, float]:
    """What the matches alone say of the focal length: factor of the one used, its log's sigma.

    Far from 1, the photo was taken by another camera than was assumed.
    """
    view = hypothesis.view
    seen = query.sightings(hypothesis.matches, view)
    free = refine(view, seen, Lens(view.intrinsics, float("inf")))
    return free.view.intrinsics.fx / view.intrinsics.fx, float(np.sqrt(free.covariance[6, 6]))


def _verdict(hypotheses: list[Hypothesis], matches: int, query: Query) -> Located | NotLocated:
    """The best hypothesis, if the photo was taken there as good as surely, and where exactly."""
    places = _apart(hypotheses)
    chances = tuple(posterior([place.evidence for place in places]).tolist())
    inliers, wanted = places[0].inliers if places else 0, query.config.min_confidence
    if sum(chances) < wanted:
        return NotLocated("no consistent pose", matches, inliers, places, chances)
    if chances[0] < wanted:
        return NotLocated("ambiguous", matches, inliers, places, chances)
    error = sigmas(places[0], query.database.index)
    confidence = chances[0] * error.within(NEAR_M, NEAR_RAD)
    if confidence < wanted:
        reason = f"the pose is too uncertain: {error}"
        return NotLocated(reason, matches, inliers, places, chances)
    return Located(places[0], places, chances, matches, error, confidence)


def _apart(hypotheses: list[Hypothesis]) -> tuple[Hypothesis, ...]:
    """The strongest hypothesis of each place, the strongest first."""
    places: list[Hypothesis] = []
    for hypothesis in hypotheses:
        if not any(_same_place(hypothesis.view, place.view) for place in places):
            places.append(hypothesis)
    return tuple(places)


def _same_place(a: View, b: View) -> bool:
    T = se3.inverse(a.T_world_camera) @ b.T_world_camera
    near = np.linalg.norm(T[:3, 3]) < NEAR_M
    return bool(near and se3.rotation_angle(T) < NEAR_RAD)
