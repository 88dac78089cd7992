"""Two frames to the transformation between them: claim 3, S3 to S5."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.frame import Features, PoseEstimate, Rejected
from vnav.core.mapping import FrameFeatures
from vnav.registration.pairs import Pairs

SAMPLE = 3  # matched points that fix a rigid transformation
CONFIDENCE = 0.999
INLIER_SIGMAS_SQUARED = 14.2  # chi-squared, 3 degrees of freedom: 99.7 % of the right matches
LINE_SIGMAS = 2.0  # of depth: points that spread less off a line do not fix the turn about it


class Matcher(Protocol):
    """Finds which features of two frames are the same: rows (M, 2) of a's and b's."""

    def everywhere(self, a: Features, b: Features) -> NDArray[np.int32]:
        """Matches over the whole image."""

    def near(
        self, a: Features, b: Features, predicted_px: Array, radius_px: float
    ) -> NDArray[np.int32]:
        """Matches close to where a's features are predicted in b, NaN for those with no place."""


@dataclass(frozen=True)
class Sensor:
    """The camera that took frame b, how far measurements are trusted, and the matcher.

    ``camera_a``: the camera of frame a, where it is another.
    """

    intrinsics: Intrinsics
    config: RegistrationConfig
    matcher: Matcher
    camera_a: Intrinsics | None = None

    @property
    def cameras(self) -> tuple[Intrinsics, Intrinsics]:
        """Those of frame a and of frame b."""
        return self.camera_a or self.intrinsics, self.intrinsics


def register(
    a: FrameFeatures,
    b: FrameFeatures,
    sensor: Sensor,
    rng: np.random.Generator,
    predicted: Array | None = None,
) -> PoseEstimate | Rejected:
    """How camera b stands to camera a, or why that cannot be told.

    Matches, RANSAC on three matched 3D points each, then robust non-linear refinement of
    reprojection and inverse depth with the sensor's noise. Where a motion ``T_a_b`` is
    ``predicted``, the strongest features are sought near the places that it gives; unless nearly
    all of those agree, matches are also sought everywhere by the ratio test, and the motion with
    more inliers counts: near wrong places, wrong matches can agree by chance. With the motion
    found, matches are sought once more, close to where it puts them.
    """
    config = sensor.config
    near: PoseEstimate | Rejected = Rejected("no prediction")
    if predicted is not None:
        matches = matches_near(
            a, b, predicted, sensor, config.search_radius_px, config.search_features
        )
        near = _estimate(a, b, matches, sensor, rng)
        if isinstance(near, PoseEstimate) and near.inlier_share >= config.search_min_inlier_share:
            return _polished(near, a, b, sensor)
    matches = sensor.matcher.everywhere(a.features, b.features)
    lifted = a.has_depth[matches[:, 0]]
    if config.one_sided_depth:
        lifted |= b.has_depth[matches[:, 1]]
    everywhere = _estimate(a, b, matches[lifted], sensor, rng)
    found = [_polished(e, a, b, sensor) for e in (near, everywhere) if isinstance(e, PoseEstimate)]
    return max(found, key=lambda estimate: len(estimate.inliers), default=everywhere)


def matches_near(
    a: FrameFeatures,
    b: FrameFeatures,
    T_a_b: Array,
    sensor: Sensor,
    radius_px: float,
    strongest: int | None = None,
) -> NDArray[np.int32]:
    """Rows (M, 2) of a's and b's features that match close to where a motion puts one's point.

    Points of a are sought in b; where ``one_sided_depth``, those of b that are left are sought in
    a, among the features that have no depth. Only the ``strongest`` are sought, or all.
    """

    def sought(
        a: FrameFeatures, b: FrameFeatures, T_a_b: Array, of_b: Intrinsics
    ) -> NDArray[np.int32]:
        predicted_px = np.full((len(a.features), 2), np.nan)
        seen_from_b = se3.transform(se3.inverse(T_a_b), a.points_camera[:strongest])
        predicted_px[:strongest] = of_b.project(seen_from_b)
        return sensor.matcher.near(a.features, b.features, predicted_px, radius_px)

    of_a, of_b = sensor.cameras
    found = sought(a, b, T_a_b, of_b)
    if not sensor.config.one_sided_depth:
        return found
    back = sought(b, a, se3.inverse(T_a_b), of_a)[:, ::-1]
    lone = ~a.has_depth[back[:, 0]] & ~np.isin(back[:, 1], found[:, 1])
    return np.concatenate([found, back[lone]])


def _estimate(
    a: FrameFeatures,
    b: FrameFeatures,
    matches: NDArray[np.int32],
    sensor: Sensor,
    rng: np.random.Generator,
) -> PoseEstimate | Rejected:
    """The motion that matches agree on, refined on all that agree with it."""
    config = sensor.config
    if len(matches) < config.min_inliers:
        return Rejected("too few matches", len(matches))
    pairs = Pairs(a, b, matches, sensor.cameras, config)
    usable = np.flatnonzero(pairs.both)
    if len(usable) < SAMPLE:
        return Rejected("no consistent motion", len(matches))
    chosen = usable[rng.integers(len(usable), size=(config.ransac_iterations, SAMPLE))]
    threshold_sigmas = config.ransac_threshold_px / config.pixel_sigma_px
    T_a_b = pairs.consensus(chosen, threshold_sigmas, CONFIDENCE)
    return _refined(T_a_b, pairs, matches, config)


def _polished(
    found: PoseEstimate, a: FrameFeatures, b: FrameFeatures, sensor: Sensor
) -> PoseEstimate:
    """The estimate from all matches close to where the motion puts them, if those are more."""
    closer = matches_near(a, b, found.T_a_b, sensor, sensor.config.refine_radius_px)
    if len(closer) <= len(found.inliers):
        return found
    pairs = Pairs(a, b, closer, sensor.cameras, sensor.config)
    polished = _refined(found.T_a_b, pairs, closer, sensor.config)
    return polished if isinstance(polished, PoseEstimate) else found


def _refined(
    T_a_b: Array, pairs: Pairs, matches: NDArray[np.int32], config: RegistrationConfig
) -> PoseEstimate | Rejected:
    """The refined estimate, or why too little holds it."""
    T_a_b, H, squared = pairs.refined(T_a_b)
    inlier = squared < INLIER_SIGMAS_SQUARED
    count = int(inlier.sum())
    if count < config.min_inliers:
        return Rejected("too few inliers", len(matches), count)
    if count < config.min_inlier_share * len(matches):
        return Rejected("too small a share of inliers", len(matches), count)
    if _on_line(pairs.points_a(T_a_b)[inlier], config):
        return Rejected("matches on a line", len(matches), count)
    return PoseEstimate(T_a_b, H, matches[inlier], len(matches))


def _on_line(points: Array, config: RegistrationConfig) -> bool:
    """Whether points (M, 3) spread off a line by no more than noise; so do those on one spot."""
    variance = np.linalg.eigvalsh(np.cov(points.T, bias=True))[1]
    noise = config.depth_sigma_per_m2**2 * (points[:, 2] ** 4).mean()
    return bool(variance < LINE_SIGMAS**2 * noise)
