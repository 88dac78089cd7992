"""Descriptor matching by the ratio test."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.config import RegistrationConfig
from vnav.core.arrays import Floats, Rows
from vnav.core.frame import Features
from vnav.features.bit_matching import two_nearest_bits
from vnav.features.guided_matching import match_guided

TwoNearest = Callable[[NDArray[Any], NDArray[Any]], tuple[Rows, NDArray[Any], NDArray[Any]]]
FULLEST = 3  # bins of turns that are kept
BLOCK = 256  # rows at once, so that their distances stay in the cache


class DescriptorMatcher:
    """Matches by descriptor distance, over the whole image or near a prediction."""

    def __init__(self, config: RegistrationConfig) -> None:
        self._config = config

    def match(self, a: Features, b: Features) -> NDArray[np.int32]:
        """Rows (M, 2) that pass the ratio test over the whole image."""
        found = match(a, b, self._config.ratio, self._config.mutual)
        return turned_alike(a, b, found, self._config.rotation_bins)

    def match_guided(
        self, a: Features, b: Features, predicted_px: NDArray[np.float64], radius_px: float
    ) -> NDArray[np.int32]:
        """Rows (M, 2) that pass the ratio test close to their predicted places (A, 2) in b."""
        limit = self._config.max_distance * a.space.typical
        found = match_guided(a, b, predicted_px, radius_px, self._config.ratio, limit)
        return turned_alike(a, b, found, self._config.rotation_bins)

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
    two_nearest, fa, fb = _comparison(a, b)
    nearest, first, second = two_nearest(fa, fb)
    rows = np.flatnonzero(first < a.space.squared(ratio) * second)
    if mutual and len(rows):
        back, *_ = two_nearest(fb[nearest[rows]], fa)
        rows = rows[back == rows]
    return np.stack([rows, nearest[rows]], 1).astype(np.int32)


def turned_alike(
    a: Features, b: Features, matches: NDArray[np.int32], bins: int
) -> NDArray[np.int32]:
    """The matches (M, 2) whose turn from a to b is in the fullest bins of all turns.

    0 ``bins``, or features whose orientation is not known, keep all. Source: Mur-Artal, Montiel,
    Tardos, "ORB-SLAM", 2015 [004 section 2.2].
    """
    if not bins or not a.space.has_angles:
        return matches
    turn = (b.angles_rad[matches[:, 1]] - a.angles_rad[matches[:, 0]]) / (2 * np.pi)
    bin_of = np.rint(turn % 1.0 * bins).astype(int) % bins
    fullest = np.argsort(-np.bincount(bin_of, minlength=bins), kind="stable")[:FULLEST]
    return matches[np.isin(bin_of, fullest)]


def _comparison(a: Features, b: Features) -> tuple[TwoNearest, NDArray[Any], NDArray[Any]]:
    """What finds the two nearest, and the descriptors as it takes them."""
    space = a.space
    if not space.packed:
        return _two_nearest_vectors, space.vectors(a.descriptors), space.vectors(b.descriptors)
    return two_nearest_bits, space.comparable(a.descriptors), space.comparable(b.descriptors)


def _two_nearest_vectors(fa: Floats, fb: Floats) -> tuple[Rows, Floats, Floats]:
    """For each row of a the nearest of b, and the squared distances of the two nearest."""
    blocks = [_of_block(fa[start : start + BLOCK], fb) for start in range(0, len(fa), BLOCK)]
    nearest, first, second = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
    return nearest, first, second


def _of_block(fa: Floats, fb: Floats) -> tuple[Rows, Floats, Floats]:
    gain, rows = _gain(fa, fb), np.arange(len(fa))
    nearest = gain.argmax(1)
    first = gain[rows, nearest]
    gain[rows, nearest] = -np.inf
    length = np.einsum("ij,ij->i", fa, fa)
    return nearest, length - 2 * first, length - 2 * gain.max(1)


def _gain(fa: Floats, fb: Floats) -> Floats:
    """Largest where nearest: |a|^2 - 2 gain is the squared distance; exact for bytes."""
    gain = fa @ fb.T
    gain -= np.einsum("ij,ij->i", fb, fb) / 2
    return gain
