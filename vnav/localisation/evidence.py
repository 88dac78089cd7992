"""How much more likely a photo shows what it shows if it was taken at a pose than if it was not.

The image is cut into cells. In each, the map predicts landmarks, of which the photo shows some. A
cell either looks as predicted, and then a fair share of its landmarks is found, or it does not (the
pose is wrong, or something stands there now, or it is too dark), and then next to none is. Nearly
all cells of a right pose look as predicted; of a rival, a place of the map that repeats things
(windows, shelves), perhaps half of them do; of the best pose in a map that does not hold the place,
hardly any. How many is told by three distributions of the share of cells, and the share is
integrated out: cells of one photo stand and fall together.

The constants are fitted on synthetic scenes by benchmarks/calibrate_confidence.py.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.localisation.guided import Hits, Prediction
from vnav.localisation.photo import Photo

Array = NDArray[np.float64]
Beta = tuple[float, float]

COLUMNS, ROWS = 8, 6
LEAST = 3  # landmarks, and features, in a cell that says anything
SHARES = (np.arange(20) + 0.5) / 20


@dataclass(frozen=True)
class Odds:
    """Beta parameters: of the share of landmarks found in a cell, and of the share of cells."""

    found_if_alike: Beta = (5.8, 6.8)
    found_if_not: Beta = (0.13, 18.0)
    cells_if_right: Beta = (7.9, 0.28)
    cells_of_rival: Beta = (0.87, 2.0)
    cells_elsewhere: Beta = (0.5, 12.0)
    unmapped_rival: float = 0.01  # share of unmapped places that look like a rival


@dataclass(frozen=True)
class Evidence:
    """Log likelihoods (nats) of what a photo shows at a pose, were it right, or a rival's.

    ``elsewhere``: were the photo from outside of the map.
    """

    right: float
    rival: float
    elsewhere: float


NOTHING = Evidence(0.0, 0.0, 0.0)


def counted(prediction: Prediction, hits: Hits, photo: Photo) -> NDArray[np.intp]:
    """How many landmarks are found, and how many are predicted (2, C), in each cell.

    None where the photo shows next to nothing: what is covered, black or plain tells neither.
    """
    size = photo.intrinsics.size
    cells, of_features = (cells_of(px, size) for px in (prediction.px, photo.features.keypoints_px))
    found = cells[np.unique(hits.predicted)]
    counts = [np.bincount(c, minlength=COLUMNS * ROWS) for c in (found, cells, of_features)]
    return np.stack(counts[:2]) * (counts[2] >= LEAST)


def evidence(cells: NDArray[np.intp], odds: Odds = Odds()) -> Evidence:
    """What the landmarks found and predicted (2, C) in each cell tell; none predicted: nothing."""
    k, n = cells[:, cells[1] >= LEAST]
    if not len(n):
        return NOTHING
    alike = _log_beta_binomial(k, n, odds.found_if_alike)
    other = _log_beta_binomial(k, n, odds.found_if_not)
    mixed = np.logaddexp(np.log(SHARES)[:, None] + alike, np.log(1 - SHARES)[:, None] + other)
    of_share = mixed.sum(1)
    kinds = odds.cells_if_right, odds.cells_of_rival, odds.cells_elsewhere
    right, rival, elsewhere = (_log_sum(of_share + _log_weights(kind)) for kind in kinds)
    chance = odds.unmapped_rival
    unmapped = np.array([elsewhere + np.log1p(-chance), rival + np.log(chance)])
    return Evidence(right, rival, _log_sum(unmapped))


def posterior(places: Sequence[Evidence]) -> Array:
    """Probability (P,) of each place, the best first, that the photo was taken there.

    Either one place is right and the others are rivals, or none is. 0 places are legal.
    """
    if not places:
        return np.zeros(0)
    scores = [place.right - place.rival for place in places]
    scores.append(places[0].elsewhere - places[0].rival)
    return np.exp(np.array(scores) - _log_sum(np.array(scores)))[:-1]


def cells_of(px: NDArray[Any], size: tuple[int, int]) -> NDArray[np.intp]:
    """Number of the cell that each pixel (N, 2) lies in."""
    column_row = np.floor(px / size * (COLUMNS, ROWS)).astype(np.intp)
    column_row = column_row.clip(0, (COLUMNS - 1, ROWS - 1))
    return np.asarray(column_row[:, 1] * COLUMNS + column_row[:, 0])


def _log_beta_binomial(k: NDArray[np.intp], n: NDArray[np.intp], beta: Beta) -> Array:
    """Log probability of k out of n, but for the binomial coefficient, which cancels."""
    a, b = beta
    rising = [_log_rising(start, int(n.max())) for start in (a, b, a + b)]
    return np.asarray(rising[0][k] + rising[1][n - k] - rising[2][n])


def _log_rising(start: float, last: int) -> Array:
    """Log of start (start + 1) ... (start + k - 1), for k = 0 ... last."""
    return np.append(0.0, np.cumsum(np.log(start + np.arange(last))))


def _log_weights(beta: Beta) -> Array:
    weights = (beta[0] - 1) * np.log(SHARES) + (beta[1] - 1) * np.log(1 - SHARES)
    return np.asarray(weights - _log_sum(weights))


def _log_sum(logs: Array) -> float:
    """Log of the sum of the exponentials."""
    most = logs.max()
    return float(most + np.log(np.exp(logs - most).sum()))
