"""Descriptor matching by the ratio test."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vnav.config import RegistrationConfig
from vnav.core.arrays import Floats, Rows
from vnav.core.frame import Features

BLOCK = 256  # rows at once, so that their distances stay in the cache


class DescriptorMatcher:
    """Matches by descriptor distance, over the whole image or near a prediction."""

    def __init__(self, config: RegistrationConfig) -> None:
        self._config = config

    def match(self, a: Features, b: Features) -> NDArray[np.int32]:
        """Rows (M, 2) that pass the ratio test over the whole image."""
        return match(a, b, self._config.ratio, self._config.mutual)

    def match_guided(
        self, a: Features, b: Features, predicted_px: NDArray[np.float64], radius_px: float
    ) -> NDArray[np.int32]:
        """Rows (M, 2) that pass the ratio test close to their predicted places (A, 2) in b."""
        from vnav.features.guided_matching import match_guided  # numba: only where it is used

        limit = self._config.max_distance * a.space.typical
        return match_guided(a, b, predicted_px, radius_px, self._config.ratio, limit)

    def without_ratio(self) -> "DescriptorMatcher":
        """A matcher that takes the nearest however near the second nearest is."""
        return DescriptorMatcher(replace(self._config, ratio=1.0))


def match(a: Features, b: Features, ratio: float, mutual: bool = True) -> NDArray[np.int32]:
    """Rows (M, 2) of a's and b's features that are each other's nearest descriptor.

    Kept where nearest / second-nearest distance is below ``ratio`` (Lowe 2004; claim 3, S3), seen
    from a and, if ``mutual``, the nearest seen from b is the same. Fewer than two features in b
    leave the ratio undefined: no matches.
    """
    if len(a) == 0 or len(b) < 2:
        return np.zeros((0, 2), np.int32)
    fa, fb = a.space.vectors(a.descriptors), b.space.vectors(b.descriptors)
    ratio_squared = a.space.squared(ratio)
    nearest = np.empty(len(a), np.intp)
    keep = np.empty(len(a), bool)
    for start in range(0, len(a), BLOCK):
        block = slice(start, start + BLOCK)
        nearest[block], first, second = _two_nearest(fa[block], fb)
        keep[block] = first < ratio_squared * second
    rows = np.flatnonzero(keep)
    if mutual and len(rows):
        rows = rows[_gain(fb[nearest[rows]], fa).argmax(1) == rows]
    return np.stack([rows, nearest[rows]], 1).astype(np.int32)


def _two_nearest(fa: Floats, fb: Floats) -> tuple[Rows, Floats, Floats]:
    """For each row of a the nearest of b, and the squared distances of the two nearest."""
    gain, rows = _gain(fa, fb), np.arange(len(fa))
    nearest = gain.argmax(1)
    first = gain[rows, nearest]
    gain[rows, nearest] = -np.inf
    length = np.einsum("ij,ij->i", fa, fa)
    return nearest, length - 2 * first, length - 2 * gain.max(1)


def _gain(fa: Floats, fb: Floats) -> Floats:
    """Largest where nearest: |a|^2 - 2 gain is the squared distance; exact for bytes and bits."""
    gain = fa @ fb.T
    gain -= np.einsum("ij,ij->i", fb, fb) / 2
    return gain
