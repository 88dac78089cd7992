"""How much more likely a photo's matches are if it was taken at a pose than if it was not.

The image is cut into cells. In each, the map predicts landmarks, of which the photo shows some,
and the photo has features, of which the map explains some. At the right pose a fair share is
found in nearly every cell; at a wrong one nothing is, except in cells that happen to look alike
(repeated windows, shelves), and there perhaps all. Counts in a cell are therefore beta-binomial,
with one pair of parameters for right and one for wrong poses. The sum of the cells' log ratios is
the evidence; landmarks and features tell the same story twice, so it is the mean of the two.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.localisation.guided import Hits, Prediction
from vnav.localisation.photo import Photo

COLUMNS, ROWS = 8, 6
LEAST = 3  # landmarks or features in a cell that says anything


@dataclass(frozen=True)
class Shares:
    """Beta parameters of the share found in a cell, at right and at wrong poses."""

    right: tuple[float, float]
    wrong: tuple[float, float]

    def log_ratio(self, found: int, of: int) -> float:
        """How much more likely (nats) so many found are at the right pose."""
        return _log_beta_binomial(found, of, *self.right) - _log_beta_binomial(
            found, of, *self.wrong
        )


# A fifth of the landmarks and a quarter of the features are found at right poses, more or less
# everywhere; at wrong ones under a tenth, but that in few cells.
LANDMARKS = Shares(right=(1.0, 4.0), wrong=(0.15, 1.6))
FEATURES = Shares(right=(1.0, 2.5), wrong=(0.15, 1.6))


def evidence(prediction: Prediction, hits: Hits, photo: Photo) -> float:
    """Log likelihood ratio (nats) of right to wrong; 0 where the map predicts nothing."""
    size = photo.intrinsics.size
    landmark_cell = _cells(prediction.px, size)
    feature_cell = _cells(photo.features.keypoints_px, size)
    landmarks, features = _count(landmark_cell), _count(feature_cell)
    found = _count(landmark_cell[np.unique(hits.predicted)])
    explained = _count(feature_cell[np.unique(hits.feature)])
    told = landmarks >= LEAST
    both = told & (features >= LEAST)
    by_landmarks = map(LANDMARKS.log_ratio, found[told].tolist(), landmarks[told].tolist())
    by_features = map(FEATURES.log_ratio, explained[both].tolist(), features[both].tolist())
    return (sum(by_landmarks) + sum(by_features)) / 2


def _cells(px: NDArray[Any], size: tuple[int, int]) -> NDArray[np.intp]:
    column_row = np.floor(px / size * (COLUMNS, ROWS)).astype(np.intp)
    column_row = column_row.clip(0, (COLUMNS - 1, ROWS - 1))
    return np.asarray(column_row[:, 1] * COLUMNS + column_row[:, 0])


def _count(cells: NDArray[np.intp]) -> NDArray[np.intp]:
    return np.bincount(cells, minlength=COLUMNS * ROWS)


def _log_beta_binomial(k: int, n: int, a: float, b: float) -> float:
    """Log probability of k out of n, but for the binomial coefficient, which cancels."""
    return _log_beta(k + a, n - k + b) - _log_beta(a, b)


def _log_beta(a: float, b: float) -> float:
    return math.lgamma(a) + math.lgamma(b) - math.lgamma(a + b)
