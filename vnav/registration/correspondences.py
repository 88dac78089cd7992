"""Matched features of two frames as measurements of the motion between them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.mapping import FrameFeatures
from vnav.core.reduced_frame import ReducedFrame
from vnav.registration.consensus import best_motion, sharpest_motion
from vnav.registration.far_features import KNOWN, inverse_depths, points
from vnav.registration.refinement import CONVERGED, gauss_newton, normal_equations

ImagesInBlocks = tuple[ReducedFrame, ReducedFrame]

INLIER_SIGMAS_SQUARED = 14.2  # chi-squared, 3 degrees of freedom: 99.7 % of the right matches
MEDIANS = {False: 1.386, True: 2.366}  # of chi-squared of a match: with one depth, with both
NEARLY = 1e-3  # rad and m: the last step of a first motion, whose residuals tell the noise
LEAST_VARIANCE = 0.01  # times that of the settings: exact matches would divide by zero


@dataclass(frozen=True)
class Reprojections:
    """Points (M, 3) of camera a, and the pixels (M, 2) where b sees them.

    ``cameras`` (2, 4): fx, fy, cx, cy of a and of b; ``variances`` (3,) of pixel and inverse depth.
    """

    points: Array
    px: Array
    cameras: Array
    variances: Array


class Correspondences:
    """M matches: a 3D point of one frame, seen in the other as pixel and inverse depth.

    The point is a's where a has depth (``of_a``), else b's. Where neither has (``far``), it is a's,
    as far away as its parallax has told: all the less does it weigh along its ray. ``forward``: it
    is a's either way. ``images``: the two frames in blocks, where they are at hand.
    """

    def __init__(
        self,
        a: FrameFeatures,
        b: FrameFeatures,
        matches: NDArray[np.int32],
        cameras: tuple[Intrinsics, Intrinsics],
        config: RegistrationConfig,
        images: ImagesInBlocks | None = None,
    ) -> None:
        points_a, points_b = (
            k.points_camera[rows].astype(float) for k, rows in zip((a, b), matches.T, strict=True)
        )
        px_a, px_b = (
            k.features.keypoints_px[rows] for k, rows in zip((a, b), matches.T, strict=True)
        )
        self.matches, self.images = matches, images
        self.of_a = np.isfinite(points_a[:, 2])
        self.far = ~(self.of_a | np.isfinite(points_b[:, 2]))
        self.forward = self.of_a | self.far
        which = self.forward[:, None]
        px, depth_m = np.where(which, px_b, px_a), np.where(which, points_b, np.nan)[:, 2:]
        self._source = np.where(which, points_a, points_b)
        self._depth_variances = np.full(len(matches), config.depth_sigma_per_m2**2)
        if self.far.any():
            rows = matches[self.far, 0]
            self._source[self.far] = points(a, rows, cameras[0])
            self._depth_variances[self.far] = inverse_depths(a, rows)[:, 1] ** 2
        self._target = np.concatenate([px, 1 / depth_m], 1)
        self._cameras = np.stack([camera.pinhole for camera in cameras])
        self._sigmas = np.array([config.pixel_sigma_px, config.depth_sigma_per_m2])
        self._variances = np.repeat(self._sigmas, (2, 1)) ** 2
        self._points_b = points_b

    @property
    def fixes_scale(self) -> NDArray[np.bool_]:
        """Which matches (M,) have a distance: by depth, or by parallax that was seen before."""
        return np.asarray(~self.far | (self._depth_variances < KNOWN**2))

    @property
    def has_both_depths(self) -> NDArray[np.bool_]:
        """Which matches (M,) have depth at both ends."""
        return np.asarray(np.isfinite(self._target[:, 2]))

    @property
    def reprojected(self) -> Reprojections:
        """Those whose point is a's."""
        points, px = self._source[self.of_a], self._target[self.of_a, :2]
        return Reprojections(points, px, self._cameras, self._variances)

    def consensus(
        self, samples: NDArray[np.intp], threshold_sigmas: float, confidence: float
    ) -> Array:
        """``T_a_b`` (4, 4) of that sample (S, 3) that most matches agree with, by RANSAC.

        Samples are rows of matches with depth at both ends; no more of them are tried than
        ``confidence`` asks for. Squared residuals of a's points are truncated at the threshold;
        only b's own noise counts.
        """
        limits = np.repeat(self._sigmas, (2, 1)) * threshold_sigmas
        T_a_b: Array = best_motion(*self._drawn(samples), limits, confidence)
        return T_a_b

    def sharpest(self, samples: NDArray[np.intp], share: float) -> Array:
        """``T_a_b`` (4, 4) of that sample (S, 3) which a share of the matches agrees with best.

        Samples as for `consensus`.
        """
        sigmas, last = np.repeat(self._sigmas, (2, 1)), int(self.of_a.sum()) - 1
        T_a_b: Array = sharpest_motion(*self._drawn(samples), sigmas, int(share * last))
        return T_a_b

    def _drawn(
        self, samples: NDArray[np.intp]
    ) -> tuple[NDArray[np.intp], Array, Array, Array, Array]:
        """Samples as rows of a's points, these in either camera, their pixels in b, and b."""
        row = np.cumsum(self.of_a) - 1
        of_a = (points[self.of_a] for points in (self._source, self._points_b, self._target[:, :2]))
        return row[samples], *of_a, self._cameras[1]

    def refined(self, T_a_b: Array) -> tuple[Array, Array, Array]:
        """Gauss-Newton from one motion: the best, its information (6, 6), squared residuals (M,).

        Residuals are in standard deviations of both measurements: the target's own, and the
        source's carried over by the motion; the sums are weighted by a Cauchy kernel. Infinite
        behind the camera.

        The first motion takes the noise of the settings, which must do for any sensor; then the
        residuals tell it. The sharper it is known, the less weighs what moves slowly, as the leg
        that somebody stands on. Information and residuals stay with the settings.
        """
        settings = self._variances, self._depth_variances
        T_a_b, _, squared = gauss_newton(T_a_b, *self._measured, *settings, NEARLY)
        shown = self._shown(squared)
        sharper = shown * self._variances, shown * self._depth_variances
        T_a_b, _, _ = gauss_newton(T_a_b, *self._measured, *sharper, CONVERGED)
        H, _, squared = normal_equations(T_a_b, *self._measured, *settings, 1.0)
        return T_a_b, H, squared

    def _shown(self, squared: Array) -> float:
        """The variances of matches that agree, by residuals (M,), over the settings'; at most 1."""
        agree = (squared < INLIER_SIGMAS_SQUARED) & ~self.far
        if not agree.any():
            return 1.0
        ratios = squared / np.where(self.has_both_depths, MEDIANS[True], MEDIANS[False])
        left = 1 - 6 / max(12, 2 * int(agree.sum()))  # what the motion's six values take up
        return float(np.clip(np.median(ratios[agree]) / left, LEAST_VARIANCE, 1))

    def squared(self, T_a_b: Array) -> Array:
        """Squared residuals (M,) of a motion, as `refined` gives those of the best."""
        squared: Array = normal_equations(
            T_a_b, *self._measured, self._variances, self._depth_variances, 1.0
        )[2]
        return squared

    @property
    def _measured(self) -> tuple[Array, Array, NDArray[np.bool_], Array]:
        return self._source, self._target, self.forward, self._cameras

    def points_a(self, T_a_b: Array) -> Array:
        """The matched points (M, 3) in camera a."""
        carried = se3.transform(T_a_b, self._source)
        return np.where(self.forward[:, None], self._source, carried)
