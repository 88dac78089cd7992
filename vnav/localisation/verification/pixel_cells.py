"""Where in the image a photo differs for sure from what the map shows of a view.

Edges never lie quite where they should, so a pixel differs only from all that is beside it; plain
surfaces tell the noise, and what is left of differing light.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array

Image = NDArray[np.float32]  # (H, W, 3), NaN where nothing is shown

CELL_PX = 10  # edge of a cell, of a photo in small
FILLED = 0.5  # share of a cell's pixels that must be shown
SIGMAS = 4.0  # in one channel at least: a pixel that differs
SMOOTH = 0.3  # share of the pixels that tell the noise: the smoothest
NOISE = 1.0, 2.5  # grey levels, at least and at most
FAR = 1e6  # grey levels: beyond what any pixel has
AROUND = np.ones((3, 3), np.uint8)


def noise(photo: Image, views: Sequence[Image]) -> Array:
    """Standard deviation (3,) by channel of a photo about the view that fits it best.

    Where it is smooth; between the least and the most that light and sensor account for.
    """
    found = [_smooth_noise(photo, view) for view in views if np.isfinite(view).any()]
    return np.clip(np.min(found, axis=0), *NOISE) if found else np.full(3, NOISE[1])


def misfits(photo: Image, view: Image, sigma: Array) -> Array:
    """Share of the pixels of each cell (R, C) that differ by far more than noise.

    NaN where less than half of a cell is shown.
    """
    off = np.minimum(_beyond(photo, *_range(view)), _beyond(view, *_range(photo)))
    shown = np.asarray(np.isfinite(view).all(2))
    differs = shown & np.asarray((off > SIGMAS * sigma).any(2))
    counts, differing = _summed(shown), _summed(differs)
    share = differing / np.maximum(counts, 1)
    return np.where(counts >= FILLED * CELL_PX**2, share, np.nan)


def _smooth_noise(photo: Image, view: Image) -> Array:
    ranges = [high - low for low, high in (_range(photo), _range(view))]
    range_of = np.where(np.isfinite(view), np.maximum(*ranges), np.inf).max(2)
    smooth = range_of <= np.quantile(range_of[np.isfinite(range_of)], SMOOTH)
    return np.asarray(1.48 * np.median(np.abs(photo - view)[smooth], axis=0))


def _range(image: Image) -> tuple[Image, Image]:
    """The least and the most that each pixel and those beside it have; of those that are shown."""
    shown = np.isfinite(image)
    low = cv2.erode(np.where(shown, image, FAR).astype(np.float32), AROUND)
    high = cv2.dilate(np.where(shown, image, -FAR).astype(np.float32), AROUND)
    return np.asarray(low), np.asarray(high)


def _beyond(image: Image, low: Image, high: Image) -> Image:
    """How far an image lies outside of a range."""
    return np.asarray(np.maximum(np.maximum(low - image, image - high), 0))


def _summed(flags: NDArray[np.bool_]) -> Array:
    """How many pixels of each cell (R, C); what is left over beside the last cell is left out."""
    rows, columns = (n // CELL_PX for n in flags.shape)
    cut = flags[: rows * CELL_PX, : columns * CELL_PX].reshape(rows, CELL_PX, columns, CELL_PX)
    return np.asarray(cut.sum((1, 3)), float)
