"""Which matches agree on one motion, when one match is enough to tell it: [000 eq 7, 3.2, 3.3].

Source: Civera, Grasa, Davison, Montiel, "1-point RANSAC for EKF filtering", 2010.
"""

import math
from dataclasses import dataclass

import numpy as np

from vnav.core.arrays import Array, Rows
from vnav.core.camera import Intrinsics
from vnav.tracking.ekf.measurement_model import Measurement, pixels
from vnav.tracking.ekf.state import FilterState
from vnav.tracking.ekf.update import innovation_covariances, moved_by

CONFIDENCE = 0.99  # that one draw at least is of right matches only
LOW_SIGMAS = 2.0  # a pixel so near to a hypothesis has a low innovation
MOST_DRAWS = 100
CHI2_99 = 9.21  # two degrees of freedom, 99 %


@dataclass(frozen=True)
class Consensus:
    """Rows of the matches that agree on one motion, and how many motions were drawn."""

    rows: Rows
    draws: int


def draws_needed(share: float, size: int, confidence: float = CONFIDENCE) -> float:
    """Draws of ``size`` matches until one is right with that confidence: log(1-p) / log(1-w^m).

    ``share``: of right matches. Infinite where none is right.
    """
    right = share**size
    if right >= 1:
        return 1.0
    return math.log(1 - confidence) / math.log1p(-right) if right > 0 else math.inf


def low_innovation_inliers(
    state: FilterState,
    measurement: Measurement,
    found_px: Array,
    camera: Intrinsics,
    sigma_px: float,
    rng: np.random.Generator,
    size: int = 1,
) -> Consensus:
    """The matches that the best motion explains; the draws are renewed from their share: eq 7.

    One match is enough where the state predicts the motion; ``size``: more, where it does not.
    """
    best, draws = np.zeros(0, np.intp), 0
    n = len(found_px)
    while n >= size and draws < min(MOST_DRAWS, draws_needed(len(best) / n, size)):
        sample = rng.choice(n, size, replace=False)
        x = moved_by(state, measurement[sample], found_px[sample], sigma_px)
        off_px = np.linalg.norm(found_px - pixels(x, measurement.features, camera), axis=1)
        inliers = np.flatnonzero(off_px < LOW_SIGMAS * sigma_px)
        draws += 1
        if len(inliers) > len(best):
            best = inliers
    return Consensus(best, draws)


def high_innovation_inliers(
    state: FilterState, measurement: Measurement, found_px: Array, sigma_px: float
) -> Rows:
    """Rows of matches (N,) that the state, updated by the others, bears out by chi-squared.

    ``measurement``: h and H at the updated state. Near features tell translation: they may have
    been far off before.
    """
    off = found_px - measurement.pixels
    S = innovation_covariances(state.P, measurement, sigma_px)
    distance = np.einsum("ni,ni->n", off, np.linalg.solve(S, off[:, :, None])[:, :, 0])
    return np.flatnonzero(distance < CHI2_99)
