"""Points of one frame held against an image of the other: residuals and what they tell.

The image is of inverse depth or of brightness. Source: Kerl, Sturm, Cremers 2013, "Dense visual
SLAM for RGB-D cameras".
"""

from dataclasses import dataclass, replace

import numpy as np

from vnav.compiled import compiled
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.robust import robust_sigma
from vnav.registration.compiled_geometry import MIN_Z_M, inverse, jacobian, transform
from vnav.registration.refinement import CAUCHY_SIGMAS

MAX_GAIN = 4.0  # between two images, or its inverse
INLIER_SIGMAS = 3.0


@dataclass
class ResidualTerm:
    """Points (M, 3) of a, and an image (H, W, 3) of b that tells what is seen where they fall.

    The image holds a value, NaN where there is none, and its gradient. ``brightness`` (M,) of the
    points in a, NaN where their inverse depth is compared. ``min_sigma``: standard deviation of a
    residual by the noise of the sensor; ``gradient_variance`` of that noise; ``correlated``: so
    many points count for one.
    """

    points: Array
    brightness: Array
    image: Array
    camera: Intrinsics
    min_sigma: float
    gradient_variance: float
    correlated: float
    sigma: float = np.inf
    gain: float = 1.0
    offset: float = 0.0

    def near(self, T_a_b: Array, sigmas: float) -> "ResidualTerm":
        """Without the points that lie off the image by more than so many sigmas of the sensor."""
        residuals = self._sums(T_a_b)[3]
        near = ~(np.abs(residuals) > sigmas * self.min_sigma)  # or on nothing
        return replace(self, points=self.points[near], brightness=self.brightness[near])

    def adapt(self, T_a_b: Array) -> None:
        """Fit the noise, gain and offset to the residuals under a motion."""
        residuals = self._sums(T_a_b)[3]
        spread = float(robust_sigma(residuals)) if np.isfinite(residuals).any() else 0.0
        self.sigma = max(self.min_sigma, spread)
        seen = np.isfinite(residuals) & np.isfinite(self.brightness)
        if seen.any():
            self._fit_exposure(self.brightness[seen], residuals[seen])

    def normal_equations(self, T_a_b: Array) -> tuple[Array, Array, Array]:
        """Normal matrix, how much of it the gradients' noise makes up, and gradient."""
        H, H_image, g, _ = self._sums(T_a_b)
        scale = self.correlated * self.sigma**2
        return H / scale, H_image * self.gradient_variance / scale, g / scale

    def agreement(self, T_a_b: Array) -> tuple[float, float]:
        """Share of points that fall on something, and of those that agree with it."""
        residuals = self._sums(T_a_b)[3]
        on = np.isfinite(residuals)
        if not on.any():
            return 0.0, 0.0
        agreeing = np.abs(residuals[on]) < INLIER_SIGMAS * self.min_sigma
        return float(on.mean()), float(agreeing.mean())

    def cost(self, T_a_b: Array) -> float:
        """Half of the squared residuals by the sensor's noise, under the kernel.

        Points that fall on nothing count as a standard deviation off.
        """
        residuals = self._sums(T_a_b)[3]
        off = np.where(np.isfinite(residuals), residuals / self.min_sigma, 1.0)
        of_points = CAUCHY_SIGMAS**2 / 2 * np.log1p((off / CAUCHY_SIGMAS) ** 2)
        return float(of_points.sum() / self.correlated)

    def _fit_exposure(self, a: Array, residuals: Array) -> None:
        """Gain and offset by mean and deviation of what both have seen: blind to a wrong motion."""
        b = self.gain * a + self.offset - residuals
        weights = 1 / (1 + (residuals / (CAUCHY_SIGMAS * self.sigma)) ** 2)
        mean_a, mean_b = np.average(a, weights=weights), np.average(b, weights=weights)
        variance_a = np.average((a - mean_a) ** 2, weights=weights)
        variance_b = np.average((b - mean_b) ** 2, weights=weights)
        gain = np.sqrt(variance_b / max(variance_a, 1e-9))
        self.gain = float(np.clip(gain, 1 / MAX_GAIN, MAX_GAIN))
        self.offset = float(mean_b - self.gain * mean_a)

    def _sums(self, T_a_b: Array) -> tuple[Array, Array, Array, Array]:
        expected = self.gain * self.brightness + self.offset
        camera = self.camera.pinhole
        sums: tuple[Array, Array, Array, Array] = _weighted_sums(
            np.asarray(T_a_b), self.points, expected, self.image, camera, self.sigma
        )
        return sums


@compiled
def _weighted_sums(
    T_a_b: Array, points: Array, expected: Array, image_b: Array, camera: Array, sigma: float
) -> tuple[Array, Array, Array, Array]:
    """Normal matrix, the same of motion in the image alone, gradient, and residuals (M,).

    Under a kernel of the given width; NaN where a point falls on nothing.
    """
    H, H_image, g = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros(6)
    residuals = np.full(len(points), np.nan)
    J, row = np.empty((3, 6)), np.empty(6)
    height, width = image_b.shape[:2]
    T_b_a = inverse(T_a_b)
    for m in range(len(points)):
        p = transform(T_b_a, points[m])
        if p[2] <= MIN_Z_M:
            continue
        u = camera[0] * p[0] / p[2] + camera[2]
        v = camera[1] * p[1] / p[2] + camera[3]
        if not (0 <= u < width - 1 and 0 <= v < height - 1):
            continue
        x, y = int(np.rint(u)), int(np.rint(v))
        value, du, dv = image_b[y, x]
        if np.isnan(value):
            continue
        of_depth = np.isnan(expected[m])
        r = (1 / p[2] if of_depth else expected[m]) - value - du * (u - x) - dv * (v - y)
        residuals[m] = r
        jacobian(J, T_a_b, p, p, camera, True)
        weight = 1 / (1 + (r / (CAUCHY_SIGMAS * sigma)) ** 2)
        for i in range(6):
            row[i] = (J[2, i] if of_depth else 0.0) - du * J[0, i] - dv * J[1, i]
        for i in range(6):
            g[i] += weight * row[i] * r
            for j in range(6):
                H[i, j] += weight * row[i] * row[j]
                H_image[i, j] += weight * (J[0, i] * J[0, j] + J[1, i] * J[1, j])
    return H, H_image, g, residuals
