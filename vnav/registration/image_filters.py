"""What dense alignment reads off an image: brightness, surfaces, and their gradients."""

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array

DepthImage = NDArray[np.float32]

DARK, CLIPPED = 5, 250  # grey levels between which exposures are compared
SURFACE_REACH_PX = 4  # of the plane that is fitted to the surface around a pixel
EDGE_SIGMAS = 2.0  # root mean square off that plane, where the surface is no edge


def exposure_gain(a: Array, b: Array) -> float:
    """How much brighter b is than a, by what is neither dark nor clipped in both."""
    shares = np.arange(1.0, 100.0)
    of_a, of_b = np.percentile(a, shares), np.percentile(b, shares)
    usable = (np.minimum(of_a, of_b) >= DARK) & (np.maximum(of_a, of_b) < CLIPPED)
    return float(np.median(of_b[usable] / of_a[usable])) if usable.any() else 1.0


def brightness_gradient(grey: Array, blur_px: float) -> Array:
    """Brightness and gradient (H, W, 3) of a blurred image."""
    blurred = cv2.GaussianBlur(grey, (0, 0), blur_px)
    kernel = np.array([[-0.5, 0.0, 0.5]])
    du, dv = (cv2.filter2D(blurred, -1, k) for k in (kernel, kernel.T))
    return np.stack([blurred, du, dv], -1)


def inverse_depth_image(depth_m: DepthImage) -> Array:
    """Inverse depth, 0 where there is none."""
    seen = depth_m > 0
    return np.where(seen, 1 / np.where(seen, depth_m, 1), 0).astype(np.float64)


def fitted_surface(depth_m: DepthImage, sigma: float, reach: int) -> Array:
    """Inverse depth and slopes (H, W, 3) by a plane around each pixel; NaN in holes, on edges."""
    inverse_depth = inverse_depth_image(depth_m)
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
    covered = cv2.boxFilter((inverse_depth > 0).astype(np.float64), -1, (len(ramp), len(ramp)))
    good = (covered > 1 - 1e-9) & (off < (EDGE_SIGMAS * sigma * reach / SURFACE_REACH_PX) ** 2)
    return np.asarray(np.where(good[..., None], np.stack([mean, du, dv], -1), np.nan))
