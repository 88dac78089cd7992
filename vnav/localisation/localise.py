"""Finding a photo in a map: search, pose, and the verdict (claim 4)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.config import LocateConfig
from vnav.core import se3
from vnav.core.frame import Rejected
from vnav.localisation.atlas import Atlas
from vnav.localisation.evidence import evidence
from vnav.localisation.guided import hits, matched, predict, reprojected
from vnav.localisation.matches import Matches
from vnav.localisation.photo import Photo
from vnav.localisation.places import fullest, places
from vnav.localisation.ransac import Consensus, Terms, agree
from vnav.localisation.refine import Focal, Sightings, refine
from vnav.localisation.search import alike, completed, seeds
from vnav.localisation.view import View

Array = NDArray[np.float64]

LEAST = 5  # matches that a pose can be tried with
ATTEMPTS = 2  # poses sought in one place: repeated things in one view give several
RIVAL_SHARE = 0.2  # of the most matches that agree; a place with fewer is no rival
FIRST_RADIUS, LAST_RADIUS = 3.0, 2.0  # of guided matching, in reprojection thresholds
SAME_PLACE_M, SAME_PLACE_RAD = 0.25, np.deg2rad(10.0)


@dataclass(frozen=True)
class Hypothesis:
    """A pose that may be right: what agrees with it, and how strongly (see `evidence`).

    ``covariance`` (6, 6), or (7, 7) with the log focal length, of ``T_world_camera``'s tangent.
    """

    view: View
    covariance: Array
    matches: Matches
    predicted: int
    evidence: float

    @property
    def inliers(self) -> int:
        """Number of matches that agree."""
        return len(self.matches)


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


def localise(
    photo: Photo, atlas: Atlas, config: LocateConfig, rng: np.random.Generator
) -> Located | NotLocated:
    """Where the photo was taken, or why that cannot be said; never a guess."""
    if len(photo.features) < config.min_features:
        return NotLocated("too few features")
    found = seeds(photo, atlas, config)
    hypotheses = _hypotheses(found, [], photo, atlas, config, rng)
    if hypotheses and hypotheses[0].evidence >= config.min_evidence:
        again = alike(hypotheses[0].matches.feature, photo, atlas, config)
    else:
        again = found = alike(np.arange(len(photo.features)), photo, atlas, config)
    hypotheses = _hypotheses(again, hypotheses, photo, atlas, config, rng)
    if not hypotheses and fullest(found, atlas.index) < config.min_inliers:
        return NotLocated("too few matches", len(found))
    return _verdict(hypotheses, len(found), config)


def own_focal(
    hypothesis: Hypothesis, photo: Photo, atlas: Atlas, config: LocateConfig
) -> tuple[float, float]:
    """What the matches alone say of the focal length: factor of the one used, its log's sigma.

    Far from 1, the photo was taken by another camera than was assumed.
    """
    view = hypothesis.view
    seen = _sightings(hypothesis.matches, view, photo, atlas, config)
    free = refine(view, seen, Focal(view.intrinsics.fx, float("inf")))
    return free.view.intrinsics.fx / view.intrinsics.fx, float(np.sqrt(free.covariance[6, 6]))


def _hypotheses(
    found: Matches,
    known: list[Hypothesis],
    photo: Photo,
    atlas: Atlas,
    config: LocateConfig,
    rng: np.random.Generator,
) -> list[Hypothesis]:
    """The known hypotheses and those of the places that the matches tell of, the strongest first.

    A place that can only muster a small part of the fullest's matches is left.
    """
    views = [h.view for h in known]
    most = max((h.inliers for h in known), default=0)
    agreed: list[Consensus] = []
    for place in places(found, atlas.index, config.places, max(LEAST, int(RIVAL_SHARE * most))):
        matches = completed(place.matches, photo, atlas, config)
        for _ in range(ATTEMPTS):
            matches = _unexplained(matches, photo, atlas, views, config)
            least = max(LEAST, int(RIVAL_SHARE * most))
            consensus = _consensus(matches, photo, atlas, config, least, rng)
            if consensus is None:
                break
            agreed.append(consensus)
            views.append(consensus.view)
            most = max(most, int(consensus.inliers.sum()))
    strong = [c.view for c in agreed if c.inliers.sum() >= RIVAL_SHARE * most]
    verified = [_verified(view, photo, atlas, config) for view in strong]
    return sorted([*known, *(h for h in verified if h)], key=lambda h: -h.evidence)


def _consensus(
    matches: Matches,
    photo: Photo,
    atlas: Atlas,
    config: LocateConfig,
    least: int,
    rng: np.random.Generator,
) -> Consensus | None:
    """A pose that ``least`` of the matches agree with, None where there is none."""
    seen = _sightings(matches, View(np.eye(4), photo.intrinsics), photo, atlas, config)
    threshold = config.ransac_threshold_px * photo.pixel
    terms = Terms(threshold, least, config.ransac_iterations, config.solver)
    return agree(photo.intrinsics, photo.focal, seen, terms, rng)


def _unexplained(
    matches: Matches, photo: Photo, atlas: Atlas, views: list[View], config: LocateConfig
) -> Matches:
    """The matches that no view so far agrees with."""
    points, px = _seen(matches, photo, atlas)
    threshold = config.ransac_threshold_px * photo.pixel
    left = np.ones(len(matches), bool)
    for view in views:
        left &= view.squared_errors(points, px) >= threshold**2
    return matches[left]


def _verified(view: View, photo: Photo, atlas: Atlas, config: LocateConfig) -> Hypothesis | None:
    """The pose after guided matching of what the map predicts, None where that finds too little."""
    near = config.ransac_threshold_px * photo.pixel
    prediction = predict(view, atlas)
    found = hits(prediction, photo, atlas, FIRST_RADIUS * near)
    matches = matched(found, prediction, atlas)
    if len(matches) < config.min_inliers:
        return None
    view = refine(view, _sightings(matches, view, photo, atlas, config), photo.focal).view
    prediction = reprojected(prediction.rows, view, atlas)
    found = hits(prediction, photo, atlas, LAST_RADIUS * near)
    matches = matched(found, prediction, atlas)
    if len(matches) < config.min_inliers:
        return None
    refined = refine(view, _sightings(matches, view, photo, atlas, config), photo.focal)
    strength = evidence(prediction, found, photo)
    return Hypothesis(refined.view, refined.covariance, matches, len(prediction), strength)


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


def _seen(
    matches: Matches, photo: Photo, atlas: Atlas
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    points = atlas.index.points_world[matches.landmark]
    return points, photo.features.keypoints_px[matches.feature]


def _sightings(
    matches: Matches, view: View, photo: Photo, atlas: Atlas, config: LocateConfig
) -> Sightings:
    """The matches with the variance of keypoint and projected landmark."""
    points, px = _seen(matches, photo, atlas)
    depth = np.maximum(view.project(points)[1], 0.1)
    landmark_px = view.intrinsics.fx * atlas.index.sigma_m[matches.landmark] / depth
    keypoint_px = config.pixel_sigma_px * photo.pixel
    return Sightings(points, px, keypoint_px**2 + landmark_px**2)
