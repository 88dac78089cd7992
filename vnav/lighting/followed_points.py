"""How bright the same surfaces are at two places of the image: points followed between frames."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Floats

WIDTH_PX = 320  # of the images that are compared
POINTS, QUALITY, APART_PX = 400, 0.01, 6  # of Shi and Tomasi's corners, at most
WINDOW_PX, LEVELS = 15, 3
STOP = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 10, 0.03)  # iterations, px
MAX_BACK_PX = 0.5  # between a point and where it is found again from where it was found
SOFT_PX = 2.0  # blur of the brightness that is read: noise and half a pixel do not count
AROUND_PX = 8.0  # what brightness is compared with to follow points, a standard deviation
DARKEST, BRIGHTEST = 12.0, 250.0  # grey levels that tell of the light
FEWEST = 20  # points of two frames

Image = NDArray[np.uint8]


@dataclass(frozen=True)
class LitImage:
    """A frame made small.

    ``even`` (h, w) uint8: brightness as it differs from what is around, whatever the light;
    ``soft`` (h, w) float32: brightness; ``peak`` (h, w) uint8: the brightest colour near a pixel.
    """

    even: Image
    soft: Floats
    peak: Image


@dataclass(frozen=True)
class Changes:
    """N surface points of two frames.

    ``r2_a``, ``r2_b`` (N,): squares of their distances from the image centre, 1 in the corners;
    ``y_a``, ``y_b`` (N,): how far down they are, 1 at the bottom; ``log_ratio`` (N,): the logarithm
    of how much brighter they are in b.
    """

    r2_a: NDArray[np.float64]
    r2_b: NDArray[np.float64]
    y_a: NDArray[np.float64]
    y_b: NDArray[np.float64]
    log_ratio: NDArray[np.float64]


def lit_image(color: Image) -> LitImage:
    """What is compared of a colour image (H, W, 3)."""
    height, width = color.shape[:2]
    size = WIDTH_PX, max(1, round(height * WIDTH_PX / width))
    small = cv2.resize(np.asarray(color), size, interpolation=cv2.INTER_AREA)
    grey = cv2.cvtColor(small, cv2.COLOR_RGB2GRAY).astype(np.float32)
    off = grey - cv2.GaussianBlur(grey, (0, 0), AROUND_PX)
    spread = np.sqrt(cv2.GaussianBlur(off * off, (0, 0), AROUND_PX))
    even = np.clip(128 + 40 * off / np.maximum(spread, 3), 0, 255).astype(np.uint8)
    reach = np.ones((9, 9), np.uint8)
    peak = cv2.dilate(small.max(-1), reach)
    return LitImage(even, np.asarray(cv2.GaussianBlur(grey, (0, 0), SOFT_PX)), np.asarray(peak))


def changes(a: LitImage, b: LitImage) -> Changes | None:
    """How the brightness of points of a changed in b; None where too few are found again."""
    if a.even.shape != b.even.shape:
        return None
    found = cv2.goodFeaturesToTrack(a.even, POINTS, QUALITY, APART_PX)
    if found is None:
        return None
    px_a = found.reshape(-1, 2)
    px_b, seen = _follow(a.even, b.even, px_a)
    back, seen_back = _follow(b.even, a.even, px_b)
    good = seen & seen_back & (np.linalg.norm(back - px_a, axis=1) < MAX_BACK_PX)
    good &= _inside(px_a, a.even.shape) & _inside(px_b, a.even.shape)
    if good.sum() < FEWEST:
        return None
    px_a, px_b = px_a[good], px_b[good]
    light_a, light_b = _at(a.soft, px_a), _at(b.soft, px_b)
    told = (np.minimum(light_a, light_b) > DARKEST) & (_at(a.peak, px_a) < BRIGHTEST)
    told &= _at(b.peak, px_b) < BRIGHTEST
    if told.sum() < FEWEST:
        return None
    px_a, px_b = px_a[told], px_b[told]
    r2_a, r2_b = (_r2(px, a.even.shape) for px in (px_a, px_b))
    y_a, y_b = ((px[:, 1] + 0.5).astype(np.float64) / len(a.even) for px in (px_a, px_b))
    return Changes(r2_a, r2_b, y_a, y_b, np.log(light_b[told] / light_a[told]))


def _follow(a: Image, b: Image, px: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Where b shows points (N, 2) of a, and which it shows."""
    window = (WINDOW_PX, WINDOW_PX)
    there, seen, _ = cv2.calcOpticalFlowPyrLK(
        a, b, px, np.zeros_like(px), winSize=window, maxLevel=LEVELS, criteria=STOP
    )
    return np.asarray(there), np.ravel(seen) > 0


def _inside(px: Floats, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Which points are so far from the border that all of their brightness is seen."""
    margin = 2 * SOFT_PX
    limit = np.array(shape[::-1]) - 1 - margin
    return np.asarray(((px > margin) & (px < limit)).all(1))


def _at(image: Floats | Image, px: Floats) -> NDArray[np.float64]:
    """Values (N,) of an image at points (N, 2)."""
    sampled = cv2.remap(image, px[:, 0].copy(), px[:, 1].copy(), cv2.INTER_LINEAR)
    return np.ravel(sampled).astype(np.float64)


def _r2(px: Floats, shape: tuple[int, ...]) -> NDArray[np.float64]:
    centre = (np.array(shape[::-1], np.float64) - 1) / 2
    return np.asarray(((px - centre) ** 2).sum(1) / (centre**2).sum())
