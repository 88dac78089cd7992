"""How much more likely a photo's matches are if it was taken at a pose than if it was not.

The image is cut into cells. In each, the map predicts landmarks and the photo shows some of them.
At the right pose a fair share is found, in nearly every cell; at a wrong one nothing is, except
in cells that happen to look alike (repeated windows, shelves), and there perhaps all. Counts in a
cell are therefore beta-binomial, with one pair of parameters for right and one for wrong poses;
the sum of the cells' log ratios is the evidence.
"""

import math

import numpy as np
from numpy.typing import NDArray

from vnav.localisation.guided import Hits, Prediction

COLUMNS, ROWS = 8, 6
MIN_PREDICTED = 3  # in a cell that says anything
RIGHT = (0.8, 4.0)  # beta parameters: a sixth is found, more or less everywhere
WRONG = (0.1, 2.0)  # next to nothing is found in most cells, much in a few


def evidence(prediction: Prediction, hits: Hits, size: tuple[int, int]) -> float:
    """Log likelihood ratio (nats) of right to wrong; 0 where the map predicts nothing."""
    cell = np.floor(prediction.px / size * (COLUMNS, ROWS)).astype(np.intp)
    cell = cell[:, 1] * COLUMNS + cell[:, 0]
    found = np.zeros(len(prediction), bool)
    found[hits.predicted] = True
    n = np.bincount(cell, minlength=COLUMNS * ROWS)
    k = np.bincount(cell[found], minlength=COLUMNS * ROWS)
    told = n >= MIN_PREDICTED
    return sum(_log_ratio(*counts) for counts in zip(k[told].tolist(), n[told].tolist(), strict=True))


def _log_ratio(k: int, n: int) -> float:
    return _log_beta_binomial(k, n, *RIGHT) - _log_beta_binomial(k, n, *WRONG)


def _log_beta_binomial(k: int, n: int, a: float, b: float) -> float:
    """Log probability of k out of n, but for the binomial coefficient, which cancels."""
    return _log_beta(k + a, n - k + b) - _log_beta(a, b)


def _log_beta(a: float, b: float) -> float:
    return math.lgamma(a) + math.lgamma(b) - math.lgamma(a + b)
