"""Motion by all pixels, near what the matches agree on."""

import numpy as np

from vnav.config import RegistrationConfig
from vnav.core.arrays import Array
from vnav.core.frame import PoseEstimate, Rejected
from vnav.registration.correspondences import INLIER_SIGMAS_SQUARED, Correspondences
from vnav.registration.dense import align_reduced
from vnav.registration.estimators.agreement import agreed
from vnav.registration.estimators.points3d import Points3dEstimator


class DirectEstimator:
    """Aligns surfaces and brightness of two reduced frames: Kerl, Sturm, Cremers 2013.

    Matches say where to begin, and which of them agree with the motion found; no more. Without
    images, as between keyframes that may close a loop, the estimate is that of the points.
    """

    def __init__(self, config: RegistrationConfig) -> None:
        self._config = config
        self._points = Points3dEstimator(config)

    def estimate(
        self, correspondences: Correspondences, rng: np.random.Generator
    ) -> PoseEstimate | Rejected:
        """By alignment from the motion that most matches agree with."""
        first = self._points.estimate(correspondences, rng)
        if isinstance(first, Rejected):
            return first
        return self.refine(first.T_a_b, correspondences)

    def refine(self, T_a_b: Array, correspondences: Correspondences) -> PoseEstimate | Rejected:
        """By alignment from a first motion, which decides directions that the images leave open."""
        images = correspondences.images
        if images is None:
            return self._points.refine(T_a_b, correspondences)
        aligned = align_reduced(*images, self._config, T_a_b)
        if isinstance(aligned, Rejected):
            return aligned
        inlier = correspondences.squared(aligned.T_a_b) < INLIER_SIGMAS_SQUARED
        T_a_b, information = aligned.T_a_b, aligned.information
        return agreed(T_a_b, information, inlier, correspondences, self._config)
