"""Finding a photo in a map: search, poses, and the verdict (claim 4)."""

from dataclasses import dataclass

import numpy as np

from vnav.config import LocateConfig
from vnav.core import se3
from vnav.core.frame import Rejected
from vnav.localisation.hypotheses import Hypothesis, pursue
from vnav.localisation.places import fullest
from vnav.localisation.query import Query
from vnav.localisation.refine import Lens, refine
from vnav.localisation.search import alike, seeds
from vnav.localisation.view import View

SAME_PLACE_M, SAME_PLACE_RAD = 0.25, np.deg2rad(10.0)


@dataclass(frozen=True)
class Located:
    """The answer, every hypothesis with the answer first, and the matches the search had found."""

    best: Hypothesis
    hypotheses: tuple[Hypothesis, ...]
    matches: int

    @property
    def inliers(self) -> int:
        """Number of matches that agree with the answer."""
        return self.best.inliers


@dataclass(frozen=True)
class NotLocated(Rejected):
    """Why the photo was not located, and the hypotheses that were not good enough."""

    hypotheses: tuple[Hypothesis, ...] = ()


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
    if hypotheses and hypotheses[0].evidence >= config.min_evidence:
        again = alike(hypotheses[0].matches.feature, query)
    else:
        again = found = alike(np.arange(len(features)), query)
    hypotheses = pursue(again, hypotheses, query, rng)
    if not hypotheses and fullest(found, query.atlas.index) < config.min_inliers:
        return NotLocated("too few matches", len(found))
    return _verdict(hypotheses, len(found), config)


def own_focal(hypothesis: Hypothesis, query: Query) -> tuple[float, float]:
    """What the matches alone say of the focal length: factor of the one used, its log's sigma.

    Far from 1, the photo was taken by another camera than was assumed.
    """
    view = hypothesis.view
    seen = query.sightings(hypothesis.matches, view)
    free = refine(view, seen, Lens(view.intrinsics, float("inf")))
    return free.view.intrinsics.fx / view.intrinsics.fx, float(np.sqrt(free.covariance[6, 6]))


def _verdict(
    hypotheses: list[Hypothesis], matches: int, config: LocateConfig
) -> Located | NotLocated:
    """The strongest hypothesis, if it is strong enough and no other place comes near it."""
    places = _apart(hypotheses)
    if not places or places[0].evidence < config.min_evidence:
        inliers = max((h.inliers for h in places), default=0)
        return NotLocated("no consistent pose", matches, inliers, places)
    best = places[0]
    if len(places) > 1 and best.evidence - places[1].evidence < config.min_margin:
        return NotLocated("ambiguous", matches, best.inliers, places)
    return Located(best, places, matches)


def _apart(hypotheses: list[Hypothesis]) -> tuple[Hypothesis, ...]:
    """The strongest hypothesis of each place, the strongest first."""
    places: list[Hypothesis] = []
    for hypothesis in hypotheses:
        if not any(_same_place(hypothesis.view, place.view) for place in places):
            places.append(hypothesis)
    return tuple(places)


def _same_place(a: View, b: View) -> bool:
    T = se3.inverse(a.T_world_camera) @ b.T_world_camera
    near = np.linalg.norm(T[:3, 3]) < SAME_PLACE_M
    return bool(near and se3.rotation_angle(T) < SAME_PLACE_RAD)
