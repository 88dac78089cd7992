"""The motion that correspondences agree on, with its information, or why there is none."""

import numpy as np

from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import PoseEstimate, Rejected
from vnav.registration.correspondences import Correspondences

SAMPLE = 3  # matched points that fix a rigid transformation
CONFIDENCE = 0.999
INLIER_SIGMAS_SQUARED = 14.2  # chi-squared, 3 degrees of freedom: 99.7 % of the right matches
LINE_SIGMAS = 2.0  # of depth: points that spread less off a line do not fix the turn about it


def estimate_motion(
    correspondences: Correspondences, config: RegistrationConfig, rng: np.random.Generator
) -> PoseEstimate | Rejected:
    """``T_a_b`` by RANSAC, then refined on all matches that agree with it: claim 3, S5.

    Rejected where too few matches have depth at both ends, or as `refine_motion` says.
    """
    matches = correspondences.matches
    usable = np.flatnonzero(correspondences.has_both_depths)
    if len(usable) < SAMPLE:
        return Rejected("no consistent motion", len(matches))
    samples = usable[rng.integers(len(usable), size=(config.ransac_iterations, SAMPLE))]
    threshold_sigmas = config.ransac_threshold_px / config.pixel_sigma_px
    T_a_b = correspondences.consensus(samples, threshold_sigmas, CONFIDENCE)
    return refine_motion(T_a_b, correspondences, config)


def refine_motion(
    T_a_b: Array, correspondences: Correspondences, config: RegistrationConfig
) -> PoseEstimate | Rejected:
    """The estimate refined from a first motion; Rejected where the inliers do not fix it."""
    matches = correspondences.matches
    refined, information, squared = correspondences.refined(T_a_b)
    T_a_b = se3.orthonormal(refined)  # else rounding grows from prediction to prediction
    inlier = squared < INLIER_SIGMAS_SQUARED
    count = int(inlier.sum())
    if count < config.min_inliers:
        return Rejected("too few inliers", len(matches), count)
    if count < config.min_inlier_share * len(matches):
        return Rejected("too small a share of inliers", len(matches), count)
    if _are_collinear(correspondences.points_a(T_a_b)[inlier], config):
        return Rejected("matches on a line", len(matches), count)
    return PoseEstimate(T_a_b, information, matches[inlier], len(matches))


def _are_collinear(points: Array, config: RegistrationConfig) -> bool:
    """Whether points (M, 3) spread off a line by no more than noise; so do those on one spot."""
    variance = np.linalg.eigvalsh(np.cov(points.T, bias=True))[1]
    noise = config.depth_sigma_per_m2**2 * (points[:, 2] ** 4).mean()
    return bool(variance < LINE_SIGMAS**2 * noise)
