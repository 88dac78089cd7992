"""Two frames as the images that dense alignment compares: surfaces, and brightness.

Depth as inverse depth, in which planes are exact and the noise of a structured-light sensor is
even; brightness up to gain and offset. Source: Kerl, Sturm, Cremers 2013, "Dense visual SLAM for
RGB-D cameras".
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.frame import Frame
from vnav.core.reduced_frame import ReducedFrame
from vnav.registration.image_filters import (
    SURFACE_REACH_PX,
    DepthImage,
    brightness_gradient,
    exposure_gain,
    fitted_surface,
)
from vnav.registration.residual_term import ResidualTerm

GAIN_STRIDE_PX = 4  # between the pixels that tell how much brighter an image is
STRIDE_PX, FINE_STRIDE_PX = 6, 2  # between the points; of brightness in the two sharpest images
CORRELATED = 9.0  # points a stride apart err alike: so many count for one
REACH_OF_BLUR = 4 / 3  # times the blur: reach of the plane fitted to a blurred image's surface
SLOPE_PIXELS = 540.0  # variance of a pixel over that of such a plane's slope
GREY_NOISE = 3.0  # of a pixel
GREY_SIGMA = 1.0  # between two blurred ones, at least
MIN_GRADIENT_SIGMAS = 4.0  # of a gradient's noise; a pixel with less gradient tells nothing

Image = NDArray[Any]  # grey or colour


@dataclass(frozen=True)
class ImagePair:
    """Depth (H, W) of two frames, and their brightness at one exposure."""

    depth_a_m: DepthImage
    depth_b_m: DepthImage
    brightness_a: Array
    brightness_b: Array
    intrinsics: Intrinsics

    @classmethod
    def of(cls, a: Frame, b: Frame, intrinsics: Intrinsics) -> "ImagePair":
        """Of whole frames."""
        exposed = _equally_exposed(a.color, b.color)
        grey_a, grey_b = (cv2.cvtColor(c, cv2.COLOR_RGB2GRAY).astype(float) for c in exposed)
        return cls(a.depth_m, b.depth_m, grey_a, grey_b, intrinsics)

    @classmethod
    def of_blocks(cls, a: ReducedFrame, b: ReducedFrame) -> "ImagePair":
        """Of frames in blocks."""
        grey = (f.grey.astype(float) for f in (a, b))
        return cls(_depth_m(a), _depth_m(b), *_equally_exposed(*grey), b.intrinsics)

    def terms(self, blur_px: float, depth_sigma_per_m2: float) -> tuple[ResidualTerm, ResidualTerm]:
        """The surfaces and the brightness of a and b, as images blurred by so much show them."""
        a, b = self._surfaces(blur_px, depth_sigma_per_m2)
        surfaces = self._surface_term(a[..., 0], b, depth_sigma_per_m2)
        return surfaces, self._brightness_term(a[..., 0], b[..., 0], blur_px)

    def surface_term(self, blur_px: float, depth_sigma_per_m2: float) -> ResidualTerm:
        """The first of these."""
        a, b = self._surfaces(blur_px, depth_sigma_per_m2)
        return self._surface_term(a[..., 0], b, depth_sigma_per_m2)

    def _surfaces(self, blur_px: float, depth_sigma_per_m2: float) -> tuple[Array, Array]:
        reach = max(SURFACE_REACH_PX, round(REACH_OF_BLUR * blur_px))
        surface_a = fitted_surface(self.depth_a_m, depth_sigma_per_m2, reach)
        return surface_a, fitted_surface(self.depth_b_m, depth_sigma_per_m2, reach)

    def _surface_term(self, inverse_depth_a: Array, surface_b: Array, sigma: float) -> ResidualTerm:
        px = _grid(np.isfinite(inverse_depth_a), STRIDE_PX)
        points = self._points(px, inverse_depth_a)
        none = np.full(len(px), np.nan)
        slope_variance = CORRELATED * 2 * sigma**2 / SLOPE_PIXELS
        noise = np.sqrt(2) * sigma  # of a point and of the surface
        camera = self.intrinsics
        return ResidualTerm(points, none, surface_b, camera, noise, slope_variance, CORRELATED)

    def _brightness_term(
        self, inverse_depth_a: Array, inverse_depth_b: Array, blur_px: float
    ) -> ResidualTerm:
        """Where both images are of one surface: at its edge the blur mixes in what lies behind."""
        a, b = (brightness_gradient(k, blur_px) for k in (self.brightness_a, self.brightness_b))
        b = np.where(np.isfinite(inverse_depth_b)[..., None], b, np.nan)
        noise = GREY_NOISE / np.sqrt(8 * np.pi) / blur_px**2  # of a blurred image's gradient
        has_gradient = np.hypot(a[..., 1], a[..., 2]) > MIN_GRADIENT_SIGMAS * noise
        stride = STRIDE_PX if blur_px > STRIDE_PX / 2 else FINE_STRIDE_PX
        px = _grid(has_gradient & np.isfinite(inverse_depth_a), stride)
        points, brightness = self._points(px, inverse_depth_a), a[px[:, 1], px[:, 0], 0]
        correlated = CORRELATED * (STRIDE_PX / stride) ** 2
        camera = self.intrinsics
        return ResidualTerm(points, brightness, b, camera, GREY_SIGMA, noise**2, correlated)

    def _points(self, px: NDArray[np.intp], inverse_depth: Array) -> Array:
        """Points (M, 3) of pixels (M, 2)."""
        z = 1 / inverse_depth[px[:, 1], px[:, 0]]
        return np.asarray(self.intrinsics.unproject(px, z), np.float64)


def _equally_exposed(a: Image, b: Image) -> tuple[Image, Image]:
    """The darker image is made as bright as the other, and as clipped in each channel."""
    few = slice(None, None, GAIN_STRIDE_PX)
    gain = exposure_gain(a[few, few], b[few, few])
    return _brightened(a, max(gain, 1.0)), _brightened(b, 1 / min(gain, 1.0))


def _brightened(image: Image, gain: float) -> Image:
    return np.minimum(image * np.float32(gain), np.float32(255))


def _depth_m(frame: ReducedFrame) -> DepthImage:
    """Depth (H, W) of blocks, 0 where there is none."""
    known = frame.inverse_depth > 0
    return np.divide(1, frame.inverse_depth, out=np.zeros_like(frame.inverse_depth), where=known)


def _grid(wanted: NDArray[np.bool_], stride_px: int) -> NDArray[np.intp]:
    """Pixels (M, 2), u and v, of a grid, where they are wanted."""
    return np.argwhere(wanted[::stride_px, ::stride_px])[:, ::-1] * stride_px
