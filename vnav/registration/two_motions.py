"""Two motions of which one between them was found, since both are within its threshold.

A door that swings or a box that is carried moves a few pixels from frame to frame, and RANSAC
takes it for noise. The matches of each of the two agree more finely with one another. How finely
is read from those that agree best, so that a sensor whose ways look like noise has one motion.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array
from vnav.registration.correspondences import Correspondences

Matches = NDArray[np.int32]

SAMPLE, CONFIDENCE = 3, 0.99
ROUGH_SIGMAS = 1.5  # of the settings, within which the matches of one motion are
FINE_SIGMAS = 3.5  # of those that agree best
QUARTER = 1.213  # of chi-squared, 3 degrees of freedom: a quarter of the right matches is below
SIZEABLE = 0.15  # share of the matches that each motion has


def two_motions(
    of: Callable[[Matches], Correspondences],
    matches: Matches,
    iterations: int,
    rng: np.random.Generator,
) -> list[Array]:
    """Two ``T_a_b`` (4, 4) that matches (M, 2) of one motion are made of; empty where there is one.

    ``of``: what some of the matches measure. Those without depth at either end are not asked.
    """
    left, found = matches[of(matches).has_both_depths], list[Array]()
    least, limit = max(SAMPLE, SIZEABLE * len(left)), np.inf
    while len(left) >= least and len(found) < 2:
        T_a_b = _finest(of, left, iterations, rng)
        squared = of(left).squared(T_a_b)
        limit = min(limit, FINE_SIGMAS**2 * np.quantile(squared, 0.25) / QUARTER)
        fits = squared < limit
        if fits.sum() < least:
            break
        found.append(T_a_b)
        left = left[~fits]
    return found if len(found) == 2 else []


def _finest(
    of: Callable[[Matches], Correspondences],
    matches: Matches,
    iterations: int,
    rng: np.random.Generator,
) -> Array:
    """The motion that most matches agree with in little more than noise, by those that do."""
    samples, measured = rng.integers(len(matches), size=(iterations, SAMPLE)), of(matches)
    T_a_b = measured.consensus(samples, ROUGH_SIGMAS, CONFIDENCE)
    near = measured.squared(T_a_b) < ROUGH_SIGMAS**2
    refined: Array = of(matches[near]).refined(T_a_b)[0] if near.sum() >= SAMPLE else T_a_b
    return refined
