"""Bands of light: lamps on alternating current, whose light flickers while rows are read out.

A camera reads its rows one after the other. Where lamps flicker, bands lie across the image and
move from frame to frame, so the same surface is brighter in one frame than in the next, by its row
alone. Source: Poplin 2006, "An automatic flicker detection method for embedded camera systems".
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array
from vnav.lighting.falloff import LEAST_PLACES, Changed
from vnav.lighting.followed_points import Changes

BANDS = np.arange(15, 81) / 10  # over the height of the image, that are looked for
TOLD = 0.5  # share of the changes of brightness that bands must explain, in the mean
STRONG = 0.02  # of a logarithm of brightness: bands that are weaker harm nothing
MOST_CHANGE = 0.3  # of a logarithm: more is no band, but another surface
SINGULAR = 1e-10  # of the largest eigenvalue: by a camera that rests, both frames tell the same
COLUMNS = 64  # of the image whose rows are averaged
DARKEST = 8.0  # grey levels, which count for more where it is darker
SLOW = 4  # powers of the row that follow what is bright above and below


def bands_of(places: Sequence[Changed]) -> float | None:
    """How many bands lie over the height of a capture's images; None where light does not flicker.

    By how points changed from frame to frame, at some places of the capture.
    """
    pairs = [pair for place in places for pair in place]
    if len([place for place in places if len(place)]) < LEAST_PLACES:
        return None
    told = np.array([_explained(pair) for pair in pairs])
    explained, swing = told[:, 0].mean(0), np.median(told[:, 1], axis=0)
    best = int(explained.argmax())
    if explained[best] < TOLD or swing[best] < STRONG:
        return None
    return float(BANDS[best])


def without_bands(color: NDArray[np.uint8], bands: float) -> NDArray[np.uint8]:
    """An image (H, W, 3) whose rows are as bright as if no band of so many lay over it.

    What the scene's own rows have of such a wave goes, too.
    """
    height, width = color.shape[:2]
    small = cv2.resize(np.asarray(color), (COLUMNS, height), interpolation=cv2.INTER_AREA)
    grey = cv2.cvtColor(small, cv2.COLOR_RGB2GRAY).astype(np.float32)
    rows = np.median(np.log(np.maximum(grey, DARKEST)), axis=1)
    y = (np.arange(height) + 0.5) / height
    wave = _wave(y, bands)
    found = np.linalg.lstsq(np.hstack([np.vander(y, SLOW), wave]), rows, rcond=None)[0]
    gain = np.exp(-wave @ found[SLOW:]).astype(np.float32)
    whole = np.repeat(np.repeat(gain, width), 3).reshape(height, width, 3)
    return np.asarray(cv2.multiply(np.asarray(color), whole, dtype=cv2.CV_8U))


def _explained(pair: Changes) -> Array:
    """By each of `BANDS`: share of the changes of two frames that it explains, its swing (2, B)."""
    off = pair.log_ratio - np.median(pair.log_ratio)
    change = np.clip(off, -MOST_CHANGE, MOST_CHANGE)
    waves = np.concatenate([_wave(y, BANDS[:, None]) for y in (pair.y_a, pair.y_b)], -1)
    across = waves.transpose(0, 2, 1)
    inverse = np.linalg.pinv(across @ waves, rcond=SINGULAR, hermitian=True)
    fitted = np.squeeze(waves @ inverse @ (across @ change)[..., None], -1)
    power = float(change @ change)
    left = ((change - fitted) ** 2).sum(1)
    explained = 1 - left / power if power > 0 else np.zeros(len(BANDS))
    return np.stack([explained, fitted.std(1)])


def _wave(y: Array, bands: Array | float) -> Array:
    """Cosine and sine (..., N, 2) of waves at shares y (N,) of the image's height."""
    angle = 2 * np.pi * bands * y
    return np.stack([np.cos(angle), np.sin(angle)], -1)
