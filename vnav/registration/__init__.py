"""Two frames to the transformation between them: claim 3, S3 to S5."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.frame import Features, PoseEstimate, Rejected
from vnav.core.mapping import Keyframe
from vnav.registration.pairs import Pairs

Array = NDArray[np.float64]
SAMPLE = 3  # matched points that fix a rigid transformation
BATCH = 64  # hypotheses tried at once
CONFIDENCE = 0.999
CONVERGED = 1e-5  # rad and m: a tenth of what the best pair of frames can tell
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
    """The camera that took both frames, how far its measurements are trusted, and the matcher."""

    intrinsics: Intrinsics
    config: RegistrationConfig
    matcher: Matcher


def register(
    a: Keyframe,
    b: Keyframe,
    sensor: Sensor,
    rng: np.random.Generator,
    predicted: Array | None = None,
) -> PoseEstimate | Rejected:
    """How camera b stands to camera a, or why that cannot be told.

    Matches, RANSAC on three matched 3D points each, then robust non-linear refinement of
    reprojection and inverse depth with the sensor's noise. Where a motion ``T_a_b`` is
    ``predicted``, matches are first sought near the places that it gives, then everywhere by the
    ratio test. With the motion found, matches are sought once more, close to where it puts them.
    """
    verdict = Rejected("too few matches")
    for matches in _searches(a, b, sensor, predicted):
        estimate = _estimate(a, b, matches, sensor, rng)
        if isinstance(estimate, PoseEstimate):
            return estimate
        verdict = estimate
    return verdict


def _searches(
    a: Keyframe, b: Keyframe, sensor: Sensor, predicted: Array | None
) -> Iterator[NDArray[np.int32]]:
    """Matches near the predicted places, then those of the ratio test over the whole image."""
    config = sensor.config
    if predicted is not None:
        yield _near(a, b, predicted, sensor, config.search_radius_px)
    matches = sensor.matcher.everywhere(a.features, b.features)
    yield matches[a.has_depth[matches[:, 0]]]


def _near(
    a: Keyframe, b: Keyframe, T_a_b: Array, sensor: Sensor, radius_px: float
) -> NDArray[np.int32]:
    """Matches close to where a motion puts a's features in b."""
    seen_from_b = se3.transform(se3.inverse(T_a_b), a.points_camera)
    predicted_px = sensor.intrinsics.project(seen_from_b)
    return sensor.matcher.near(a.features, b.features, predicted_px, radius_px)


def _estimate(
    a: Keyframe,
    b: Keyframe,
    matches: NDArray[np.int32],
    sensor: Sensor,
    rng: np.random.Generator,
) -> PoseEstimate | Rejected:
    """The motion that matches agree on, refined on all that agree with it."""
    config = sensor.config
    if len(matches) < config.min_inliers:
        return Rejected("too few matches", len(matches))
    pairs = Pairs(a, b, matches, sensor.intrinsics, config)
    T_a_b = _ransac(pairs, config, rng)
    if T_a_b is None:
        return Rejected("no consistent motion", len(matches))
    T_a_b = _refine(T_a_b, pairs)
    found = _judge(T_a_b, pairs, matches, config)
    if isinstance(found, Rejected):
        return found
    closer = _near(a, b, T_a_b, sensor, config.polish_radius_px)
    if len(closer) <= len(found.inliers):
        return found
    pairs = Pairs(a, b, closer, sensor.intrinsics, config)
    polished = _judge(_refine(T_a_b, pairs), pairs, closer, config)
    return polished if isinstance(polished, PoseEstimate) else found


def _ransac(pairs: Pairs, config: RegistrationConfig, rng: np.random.Generator) -> Array | None:
    """The motion that most matches agree with, from minimal sets of matched 3D points."""
    usable = np.flatnonzero(pairs.both)
    if len(usable) < SAMPLE:
        return None
    best, best_cost, needed, tried = None, np.inf, config.ransac_iterations, 0
    while tried < needed:
        chosen = usable[rng.random((BATCH, len(usable))).argpartition(SAMPLE - 1, 1)[:, :SAMPLE]]
        T_a_b = se3.align(pairs.points_a[chosen], pairs.points_b[chosen])
        cost, inliers = pairs.costs(T_a_b, config.ransac_threshold_px / config.pixel_sigma_px)
        k = int(cost.argmin())
        if cost[k] < best_cost:
            best, best_cost = T_a_b[k], float(cost[k])
            share = max(float(inliers[k]) / len(pairs.points_a), 1e-3)
            trials = np.log(1 - CONFIDENCE) / np.log(1 - share**SAMPLE + 1e-12)
            needed = min(needed, int(trials) + 1)
        tried += BATCH
    return best


def _refine(T_a_b: Array, pairs: Pairs, iterations: int = 12) -> Array:
    """Gauss-Newton on whitened residuals with Cauchy weights; claim 3, S5."""
    for _ in range(iterations):
        H, g, _ = pairs.normal_equations(T_a_b)
        step = -np.linalg.solve(H + 1e-9 * (1 + np.trace(H)) * np.eye(6), g)
        T_a_b = T_a_b @ se3.exp(step)
        if np.abs(step).max() < CONVERGED:
            break
    return T_a_b


def _judge(
    T_a_b: Array, pairs: Pairs, matches: NDArray[np.int32], config: RegistrationConfig
) -> PoseEstimate | Rejected:
    """The estimate, or why too little holds it."""
    H, _, squared = pairs.normal_equations(T_a_b)
    inlier = squared < INLIER_SIGMAS_SQUARED
    count = int(inlier.sum())
    if count < config.min_inliers:
        return Rejected("too few inliers", len(matches), count)
    if count < config.min_inlier_share * len(matches):
        return Rejected("too small a share of inliers", len(matches), count)
    if _on_line(pairs.points_a[inlier], config):
        return Rejected("matches on a line", len(matches), count)
    rms_px = pairs.rms_px(T_a_b, inlier)
    return PoseEstimate(T_a_b, H, matches[inlier], len(matches), rms_px)


def _on_line(points: Array, config: RegistrationConfig) -> bool:
    """Whether points (M, 3) spread off a line by no more than noise; so do those on one spot."""
    variance = np.linalg.eigvalsh(np.cov(points.T, bias=True))[1]
    noise = config.depth_sigma_per_m2**2 * (points[:, 2] ** 4).mean()
    return bool(variance < LINE_SIGMAS**2 * noise)
