"""Matched features of two frames as measurements of the motion between them."""

import numpy as np
from numpy.typing import NDArray

from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.mapping import Keyframe
from vnav.registration.consensus import best_motion
from vnav.registration.refinement import gauss_newton

Array = NDArray[np.float64]


class Pairs:
    """M matches: a's 3D points, seen in b as pixel and, where b has depth, inverse depth."""

    def __init__(
        self,
        a: Keyframe,
        b: Keyframe,
        matches: NDArray[np.int32],
        intrinsics: Intrinsics,
        config: RegistrationConfig,
    ) -> None:
        self.points_a = a.points_camera[matches[:, 0]].astype(float)
        self.points_b = b.points_camera[matches[:, 1]].astype(float)
        self.px_b = b.features.keypoints_px[matches[:, 1]].astype(float)
        self.camera = np.array([intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy])
        self.sigmas = np.array([config.pixel_sigma_px, config.depth_sigma_per_m2])

    @property
    def both(self) -> NDArray[np.bool_]:
        """Which matches (M,) have depth at both ends."""
        return np.asarray(np.isfinite(self.points_b[:, 2]))

    def consensus(
        self, chosen: NDArray[np.intp], threshold_sigmas: float, confidence: float
    ) -> Array:
        """``T_a_b`` (4, 4) of that chosen triple (S, 3) that most matches agree with.

        Chosen are matches with depth at both ends; no more of them are tried than ``confidence``
        asks for. Squared residuals are truncated at the threshold; only b's own noise counts.
        """
        limits = np.repeat(self.sigmas, (2, 1)) * threshold_sigmas
        T_a_b: Array = best_motion(
            chosen, self.points_a, self.points_b, self.px_b, self.camera, limits, confidence
        )
        return T_a_b

    def refined(self, T_a_b: Array) -> tuple[Array, Array, Array]:
        """Gauss-Newton from one motion: the best, its information (6, 6), squared residuals (M,).

        Residuals are in standard deviations of both measurements: b's own, and a's carried over by
        the motion; the sums are weighted by a Cauchy kernel. Infinite behind b.
        """
        variances = np.repeat(self.sigmas, (2, 1)) ** 2
        T_a_b, H, squared = gauss_newton(
            T_a_b, self.points_a, self.points_b, self.px_b, self.camera, variances
        )
        return T_a_b, H, squared

    def rms_px(self, T_a_b: Array, chosen: NDArray[np.bool_]) -> float:
        """Root mean square reprojection error of the chosen matches."""
        p = se3.transform(se3.inverse(T_a_b), self.points_a[chosen])
        off = self.camera[:2] * p[:, :2] / p[:, 2:] + self.camera[2:] - self.px_b[chosen]
        return float(np.sqrt((off**2).sum(1).mean()))
