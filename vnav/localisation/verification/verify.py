"""The third room of locating: poses refined and judged by what the map predicts there."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array
from vnav.core.camera import CameraPrior
from vnav.localisation.hypotheses.hypothesise import pose_of
from vnav.localisation.hypotheses.pose_refinement import RefinedPose, either, refine_pose
from vnav.localisation.matches import Matches
from vnav.localisation.query import MIN_MATCHES, Query
from vnav.localisation.verification.cropping import log_odds_of_cropped
from vnav.localisation.verification.evidence import (
    Evidence,
    Odds,
    evidence,
    odds_of,
    posterior,
)
from vnav.localisation.verification.image_cells import cell_counts
from vnav.localisation.verification.prediction import predict, reprojected
from vnav.localisation.verification.projection_matching import match_by_projection, one_to_one
from vnav.localisation.view import View

SEARCH_RADII = 3.0, 2.0  # one after the other, in inlier thresholds
CROPPED_RADII = 25.0, 12.0, 6.0  # before, where the principal point may be anywhere
WIDE_RADIUS = 25.0  # about a pose that few matches hold, in the same


@dataclass(frozen=True)
class VerifiedPose:
    """A pose that the map bears out: what agrees with it, and how strongly (see `evidence`).

    ``cells`` (2, C): landmarks found and predicted in each cell of the image; ``odds``: those of
    the front-end that finds them.
    """

    refined: RefinedPose
    matches: Matches
    cells: NDArray[np.intp]
    odds: Odds = Odds()

    @property
    def view(self) -> View:
        """Where the camera stands and how it sees."""
        return self.refined.view

    @property
    def covariance(self) -> Array:
        """Of the view's parameters, as in `RefinedPose`."""
        return self.refined.covariance

    @cached_property
    def evidence(self) -> Evidence:
        """How much speaks for the pose."""
        return evidence(self.cells, self.odds)

    @property
    def inliers(self) -> int:
        """Number of matches that agree."""
        return len(self.matches)


def verify(views: Sequence[View], query: Query, rng: np.random.Generator) -> list[VerifiedPose]:
    """The pose of each view after guided matching, without those that find too little."""
    verified = [_verified(view, query, rng) for view in views]
    return [pose for pose in verified if pose]


def confirmed(poses: Sequence[VerifiedPose], query: Query) -> VerifiedPose | None:
    """The strongest pose, if it is likely enough were there no other place like it."""
    strongest = max(poses, key=lambda pose: pose.evidence.strength, default=None)
    if strongest is None or posterior([strongest.evidence])[0] < query.config.min_confidence:
        return None
    return strongest


def _verified(view: View, query: Query, rng: np.random.Generator) -> VerifiedPose | None:
    """The pose after guided matching; where few matches hold it, the better one of those near it.

    Few matches of things that repeat themselves can agree on a pose beside the right one, and
    guided matching then only finds what agrees with that.
    """
    first = _with_either_camera(view, query)
    if first is None or first.inliers >= query.config.enough_matches:
        return first
    around = pose_of(_matches_around(first.view, query), MIN_MATCHES, query, rng)
    second = _with_either_camera(around.view, query) if around else None
    return second if second and second.evidence.strength > first.evidence.strength else first


def _with_either_camera(view: View, query: Query) -> VerifiedPose | None:
    """The pose by the camera of a whole photo, or of a cropped one where that is likelier.

    A file does not tell whether it was cropped: where its principal point is not given, both are
    tried. Where they are about as likely, the pose is as uncertain as they differ.
    """
    camera = query.photo.camera
    whole = _guided(view, query, camera, SEARCH_RADII)
    if camera.centre_sigma == 0:
        return whole
    cropped = _guided_from_afar(view, query, replace(camera, centre_sigma=np.inf))
    if cropped is None or whole is None:
        return whole or cropped
    log_odds = log_odds_of_cropped(cropped.refined, camera)
    log_odds += cropped.evidence.strength - whole.evidence.strength
    if log_odds > 0:
        return cropped
    share = float(1 / (1 + np.exp(-log_odds)))
    return replace(whole, refined=either(whole.refined, cropped.refined, share))


def _guided(
    view: View, query: Query, camera: CameraPrior, radii: Sequence[float]
) -> VerifiedPose | None:
    """The pose after guided matching of what the map predicts, None where that finds too little."""
    photo, database = query.photo, query.database
    prediction = predict(view, database)
    for k, radius in enumerate(radii):
        if k > 0:
            prediction = reprojected(prediction.rows, view, database)
        found = match_by_projection(prediction, photo, database, radius * query.inlier_threshold_px)
        matches = one_to_one(found, prediction, database)
        if len(matches) < query.config.min_inliers:
            return None
        refined = refine_pose(view, query.correspondences(matches, view), camera)
        view = refined.view
    cells = cell_counts(prediction, found, photo)
    return VerifiedPose(refined, matches, cells, odds_of(database.tree.space))


def _guided_from_afar(view: View, query: Query, camera: CameraPrior) -> VerifiedPose | None:
    """The same, in circles so wide that the principal point may be anywhere."""
    pose = None
    for radii in (*zip(CROPPED_RADII), SEARCH_RADII):
        pose = _guided(pose.view if pose else view, query, camera, radii)
        if pose is None:
            return None
    return pose


def _matches_around(view: View, query: Query) -> Matches:
    """All that the map predicts, sought in a wide circle."""
    prediction = predict(view, query.database)
    radius_px = WIDE_RADIUS * query.inlier_threshold_px
    found = match_by_projection(prediction, query.photo, query.database, radius_px)
    return one_to_one(found, prediction, query.database)
