"""What the pixels of two frames tell of the motion between them: surfaces and brightness.

Depth as inverse depth, in which planes are exact and the noise of a structured-light sensor is
even; brightness up to gain and offset. Source: Kerl, Sturm, Cremers 2013, "Dense visual SLAM for
RGB-D cameras".
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.frame import Frame
from vnav.core.robust import robust_sigma
from vnav.registration.refinement import CAUCHY_SIGMAS, NEAREST_M, inverse, jacobian, transform

Image = NDArray[np.float32]

STRIDE_PX, FINE_STRIDE_PX = 6, 2  # between the points; of brightness in the two sharpest images
CORRELATED = 9.0  # points a stride apart err alike: so many count for one
REACH_PX = 4  # of the plane that is fitted to the surface; of a blurred image it is
REACH_OF_BLUR = 4 / 3  # times the blur
SLOPE_PIXELS = 540.0  # variance of a pixel over that of such a plane's slope
EDGE_SIGMAS = 2.0  # root mean square off that plane, where the surface is no edge
GREY_NOISE = 3.0  # of a pixel
GREY_SIGMA = 1.0  # between two blurred ones, at least
TELLING_SIGMAS = 4.0  # of a gradient's noise; a pixel with less gradient tells nothing
DARK, CLIPPED = 5, 250  # grey levels between which exposures are compared
MOST_GAIN = 4.0  # between two images, or its inverse
INLIER_SIGMAS = 3.0


@dataclass
class Compared:
    """Points (M, 3) of a, and an image (H, W, 3) of b that tells what is seen where they fall.

    The image holds a value, NaN where there is none, and its gradient. ``brightness`` (M,) of the
    points in a, NaN where their inverse depth is compared. ``least``: standard deviation of a
    residual by the noise of the sensor; ``gradient_variance`` of that noise; ``correlated``: so
    many points count for one.
    """

    points: Array
    brightness: Array
    image: Array
    camera: Intrinsics
    least: float
    gradient_variance: float
    correlated: float
    sigma: float = np.inf
    gain: float = 1.0
    offset: float = 0.0

    def adapt(self, T_a_b: Array) -> None:
        """Fit the noise, gain and offset to the residuals under a motion."""
        residuals = self._sums(T_a_b)[3]
        spread = float(robust_sigma(residuals)) if np.isfinite(residuals).any() else 0.0
        self.sigma = max(self.least, spread)
        seen = np.isfinite(residuals) & np.isfinite(self.brightness)
        if seen.any():
            self._expose(self.brightness[seen], residuals[seen])

    def _expose(self, a: Array, residuals: Array) -> None:
        """Gain and offset by mean and deviation of what both have seen: blind to a wrong motion."""
        b = self.gain * a + self.offset - residuals
        weights = 1 / (1 + (residuals / (CAUCHY_SIGMAS * self.sigma)) ** 2)
        mean_a, mean_b = np.average(a, weights=weights), np.average(b, weights=weights)
        variance_a = np.average((a - mean_a) ** 2, weights=weights)
        variance_b = np.average((b - mean_b) ** 2, weights=weights)
        gain = np.sqrt(variance_b / max(variance_a, 1e-9))
        self.gain = float(np.clip(gain, 1 / MOST_GAIN, MOST_GAIN))
        self.offset = float(mean_b - self.gain * mean_a)

    def equations(self, T_a_b: Array) -> tuple[Array, Array, Array]:
        """Normal matrix, how much of it noise of the gradients makes up, and gradient."""
        H, moved, g, _ = self._sums(T_a_b)
        scale = self.correlated * self.sigma**2
        return H / scale, moved * self.gradient_variance / scale, g / scale

    def agreement(self, T_a_b: Array) -> tuple[float, float]:
        """Share of points that fall on something, and of those that agree with it."""
        residuals = self._sums(T_a_b)[3]
        on = np.isfinite(residuals)
        if not on.any():
            return 0.0, 0.0
        return float(on.mean()), float((np.abs(residuals[on]) < INLIER_SIGMAS * self.least).mean())

    def _sums(self, T_a_b: Array) -> tuple[Array, Array, Array, Array]:
        expected = self.gain * self.brightness + self.offset
        c = self.camera
        camera = np.array([c.fx, c.fy, c.cx, c.cy])
        sums: tuple[Array, Array, Array, Array] = _sums(
            np.asarray(T_a_b), self.points, expected, self.image, camera, self.sigma
        )
        return sums


@dataclass(frozen=True)
class Images:
    """Depth (H, W) of two frames, and their brightness at one exposure."""

    depth_a_m: Image
    depth_b_m: Image
    brightness_a: Array
    brightness_b: Array
    intrinsics: Intrinsics

    @classmethod
    def of(cls, a: Frame, b: Frame, intrinsics: Intrinsics) -> "Images":
        """The darker image is made as bright as the other, and as clipped."""
        grey_a, grey_b = (cv2.cvtColor(f.color, cv2.COLOR_RGB2GRAY).astype(float) for f in (a, b))
        gain = _gain(grey_a, grey_b)
        alike_a = np.minimum(grey_a * max(gain, 1.0), 255.0)
        alike_b = np.minimum(grey_b / min(gain, 1.0), 255.0)
        return cls(a.depth_m, b.depth_m, alike_a, alike_b, intrinsics)

    def blurred(self, blur_px: float, depth_sigma_per_m2: float) -> tuple[Compared, Compared]:
        """The surfaces and the brightness of a and b, as images blurred by so much show them."""
        reach = max(REACH_PX, round(REACH_OF_BLUR * blur_px))
        surface_a = _surface(self.depth_a_m, depth_sigma_per_m2, reach)
        surface_b = _surface(self.depth_b_m, depth_sigma_per_m2, reach)
        surfaces = self._surfaces(surface_a[..., 0], surface_b, depth_sigma_per_m2)
        return surfaces, self._brightness(surface_a[..., 0], blur_px)

    def _surfaces(self, inverse_depth_a: Array, surface_b: Array, sigma: float) -> Compared:
        px = _grid(np.isfinite(inverse_depth_a), STRIDE_PX)
        points = self._lifted(px, inverse_depth_a)
        none = np.full(len(px), np.nan)
        slope_variance = CORRELATED * 2 * sigma**2 / SLOPE_PIXELS
        noise = np.sqrt(2) * sigma  # of a point and of the surface
        camera = self.intrinsics
        return Compared(points, none, surface_b, camera, noise, slope_variance, CORRELATED)

    def _brightness(self, inverse_depth_a: Array, blur_px: float) -> Compared:
        known = np.isfinite(inverse_depth_a)
        inverse_depth_a = np.where(known, inverse_depth_a, _inverse(self.depth_a_m))
        a, b = _shade(self.brightness_a, blur_px), _shade(self.brightness_b, blur_px)
        noise = GREY_NOISE / np.sqrt(8 * np.pi) / blur_px**2  # of a blurred image's gradient
        telling = np.hypot(a[..., 1], a[..., 2]) > TELLING_SIGMAS * noise
        stride = STRIDE_PX if blur_px > STRIDE_PX / 2 else FINE_STRIDE_PX
        px = _grid(telling & (inverse_depth_a > 0), stride)
        points, brightness = self._lifted(px, inverse_depth_a), a[px[:, 1], px[:, 0], 0]
        correlated = CORRELATED * (STRIDE_PX / stride) ** 2
        camera = self.intrinsics
        return Compared(points, brightness, b, camera, GREY_SIGMA, noise**2, correlated)

    def _lifted(self, px: NDArray[np.intp], inverse_depth: Array) -> Array:
        """Points (M, 3) of pixels (M, 2)."""
        z = 1 / inverse_depth[px[:, 1], px[:, 0]]
        return np.asarray(self.intrinsics.unproject(px, z), np.float64)


def _grid(wanted: NDArray[np.bool_], stride_px: int) -> NDArray[np.intp]:
    """Pixels (M, 2), u and v, of a grid, where they are wanted."""
    return np.argwhere(wanted[::stride_px, ::stride_px])[:, ::-1] * stride_px


def _gain(a: Array, b: Array) -> float:
    """How much brighter b is than a, by what is neither dark nor clipped in both."""
    shares = np.arange(1.0, 100.0)
    of_a, of_b = np.percentile(a, shares), np.percentile(b, shares)
    usable = (np.minimum(of_a, of_b) >= DARK) & (np.maximum(of_a, of_b) < CLIPPED)
    return float(np.median(of_b[usable] / of_a[usable])) if usable.any() else 1.0


def _shade(grey: Array, blur_px: float) -> Array:
    """Brightness and gradient (H, W, 3) of a blurred image."""
    blurred = cv2.GaussianBlur(grey, (0, 0), blur_px)
    kernel = np.array([[-0.5, 0.0, 0.5]])
    du, dv = (cv2.filter2D(blurred, -1, k) for k in (kernel, kernel.T))
    return np.stack([blurred, du, dv], -1)


def _inverse(depth_m: Image) -> Array:
    """Inverse depth, 0 where there is none."""
    seen = depth_m > 0
    return np.where(seen, 1 / np.where(seen, depth_m, 1), 0).astype(np.float64)


def _surface(depth_m: Image, sigma: float, reach: int) -> Array:
    """Inverse depth and slopes (H, W, 3) by a plane around each pixel; NaN in holes, on edges."""
    inverse_depth = _inverse(depth_m)
    ramp = np.arange(-reach, reach + 1.0)
    even, across = np.full(len(ramp), 1 / len(ramp)), ramp / (ramp**2).sum()
    mean, du, dv, square = (
        cv2.sepFilter2D(image, cv2.CV_64F, x, y)
        for image, x, y in (
            (inverse_depth, even, even),
            (inverse_depth, across, even),
            (inverse_depth, even, across),
            (inverse_depth**2, even, even),
        )
    )
    off = square - mean**2 - (du**2 + dv**2) * (ramp**2).mean()
    whole = (
        cv2.boxFilter((inverse_depth > 0).astype(np.float64), -1, (len(ramp), len(ramp))) > 1 - 1e-9
    )
    good = whole & (off < (EDGE_SIGMAS * sigma * reach / REACH_PX) ** 2)
    return np.asarray(np.where(good[..., None], np.stack([mean, du, dv], -1), np.nan))


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _sums(
    T_a_b: Array, points: Array, expected: Array, image_b: Array, camera: Array, sigma: float
) -> tuple[Array, Array, Array, Array]:
    """Normal matrix, the same of motion in the image alone, gradient, and residuals (M,).

    Under a kernel of the given width; NaN where a point falls on nothing.
    """
    H, moved, g = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros(6)
    residuals = np.full(len(points), np.nan)
    p, J, row = np.empty(3), np.empty((3, 6)), np.empty(6)
    height, width = image_b.shape[:2]
    T_b_a = inverse(T_a_b)
    for m in range(len(points)):
        transform(p, T_b_a, points[m])
        if p[2] <= NEAREST_M:
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
                moved[i, j] += weight * (J[0, i] * J[0, j] + J[1, i] * J[1, j])
    return H, moved, g, residuals
