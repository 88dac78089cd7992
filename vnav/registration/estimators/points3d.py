"""Motion by matched 3D points: RANSAC on three of them, then reprojection and inverse depth."""

import numpy as np

from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import PoseEstimate, Rejected
from vnav.registration.correspondences import INLIER_SIGMAS_SQUARED, Correspondences
from vnav.registration.estimators.agreement import agreed

SAMPLE = 3  # matched points that fix a rigid transformation
CONFIDENCE = 0.999


class Points3dEstimator:
    """Weighs every match by the noise of both frames, its depth included: claim 3, S5."""

    def __init__(self, config: RegistrationConfig) -> None:
        self._config = config

    def estimate(
        self, correspondences: Correspondences, rng: np.random.Generator
    ) -> PoseEstimate | Rejected:
        """By RANSAC, then refined on all matches that agree.

        Rejected where too few matches have depth at both ends, or as `refine` says.
        """
        config, usable = self._config, np.flatnonzero(correspondences.has_both_depths)
        if len(usable) < SAMPLE:
            return Rejected("no consistent motion", len(correspondences.matches))
        samples = usable[rng.integers(len(usable), size=(config.ransac_iterations, SAMPLE))]
        threshold_sigmas = config.ransac_threshold_px / config.pixel_sigma_px
        T_a_b = correspondences.consensus(samples, threshold_sigmas, CONFIDENCE)
        return self.refine(T_a_b, correspondences)

    def refine(self, T_a_b: Array, correspondences: Correspondences) -> PoseEstimate | Rejected:
        """By Gauss-Newton; Rejected where the inliers do not fix the motion."""
        refined, information, squared = correspondences.refined(T_a_b)
        T_a_b = se3.orthonormal(refined)  # else rounding grows from prediction to prediction
        inlier = squared < INLIER_SIGMAS_SQUARED
        return agreed(T_a_b, information, inlier, correspondences, self._config)
