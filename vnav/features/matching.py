"""Descriptor matching by the ratio test."""

import numpy as np
from numpy.typing import NDArray

from vnav.config import RegistrationConfig
from vnav.core.frame import Features
from vnav.features.sift import ROOT_SCALE


class DescriptorMatcher:
    """Matches by descriptor distance, everywhere or near a prediction."""

    def __init__(self, config: RegistrationConfig) -> None:
        self._config = config

    def everywhere(self, a: Features, b: Features) -> NDArray[np.int32]:
        """Rows (M, 2) that pass the ratio test over the whole image."""
        return match(a, b, self._config.ratio, self._config.mutual)

    def near(
        self, a: Features, b: Features, predicted_px: NDArray[np.float64], radius_px: float
    ) -> NDArray[np.int32]:
        """Rows (M, 2) that pass the ratio test close to their predicted places (A, 2) in b."""
        from vnav.features.guided import match_near  # numba: only where it is used

        limit = self._config.max_distance * ROOT_SCALE
        return match_near(a, b, predicted_px, radius_px, self._config.ratio, limit)


def match(a: Features, b: Features, ratio: float, mutual: bool = True) -> NDArray[np.int32]:
    """Rows (M, 2) of a's and b's features that are each other's nearest descriptor.

    Kept where nearest / second-nearest distance is below ``ratio`` (Lowe 2004; claim 3, S3), seen
    from a and, if ``mutual``, the nearest seen from b is the same. Fewer than two features in b
    leave the ratio undefined: no matches.
    """
    if len(a) == 0 or len(b) < 2:
        return np.zeros((0, 2), np.int32)
    similarity, norm_a, norm_b = _products(a.descriptors, b.descriptors)
    # For each row of a, the squared distances are norm_a - 2 * half_gain.
    half_gain = similarity - norm_b / 2
    rows = np.arange(len(a))
    nearest = half_gain.argmax(1)
    first = norm_a - 2 * half_gain[rows, nearest]
    keep = np.ones(len(a), bool)
    if mutual:
        back = (similarity - norm_a[:, None] / 2).argmax(0)
        keep = back[nearest] == rows
    half_gain[rows, nearest] = -np.inf
    second = norm_a - 2 * half_gain.max(1)
    keep &= first < ratio**2 * second
    return np.stack([rows[keep], nearest[keep]], 1).astype(np.int32)


def _products(
    a: NDArray[np.uint8], b: NDArray[np.uint8]
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Inner products (A, B) and squared lengths; exact in float32 for 128 bytes."""
    fa, fb = a.astype(np.float32), b.astype(np.float32)
    return fa @ fb.T, np.einsum("ij,ij->i", fa, fa), np.einsum("ij,ij->i", fb, fb)
