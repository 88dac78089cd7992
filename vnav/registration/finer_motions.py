"""Motions of which one between them was found, since all their matches are within its threshold.

A door that swings or a box that is carried moves a few pixels from frame to frame, and RANSAC
takes it for noise. So are somebody who passes close by and a room far behind him: a turn with a
step to the side fits both. The matches of each agree more finely with one another. How finely is
read from those that agree best, so that a sensor whose ways look like noise has one motion.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array
from vnav.registration.correspondences import Correspondences

Matches = NDArray[np.int32]

SAMPLE = 3  # matches that fix a motion
SAMPLES = 60  # where two fifths of the matches are of a motion, one has its alone, but for 2 %
SHARE, CHI_SQUARED = 0.25, 1.213  # so many right matches are below, with 3 degrees of freedom
FINE_SIGMAS = 3.5  # of those that agree best
FINER = 2.5  # times, in variance, that matches fit their own motion than the one between
SIZEABLE = 0.15  # share of the matches that each motion has


def finer_motions(
    of: Callable[[Matches], Correspondences],
    matches: Matches,
    T_a_b: Array,
    rng: np.random.Generator,
) -> list[Array]:
    """Motions (4, 4) that one, ``T_a_b``, of matches (M, 2) mixes; empty where it does not.

    Two, each of a sizeable part of the matches, or one of most, to which the others are noise.
    ``of``: what some of the matches measure. Those without depth at either end are not asked.
    """
    asked = matches[of(matches).has_both_depths]
    found, measured = _sharp(of, asked, rng), of(asked)
    if len(found) == 2 and _are_finer(found, T_a_b, measured):
        return found
    return [part for part in found[:1] if _is_finer_for_most(part, T_a_b, measured)]


def _sharp(
    of: Callable[[Matches], Correspondences], matches: Matches, rng: np.random.Generator
) -> list[Array]:
    """At most two motions (4, 4), each of a sizeable part of matches that agree most closely."""
    left, found = matches, list[Array]()
    least, limit = max(SAMPLE, SIZEABLE * len(left)), np.inf
    while len(left) >= least and len(found) < 2:
        part, squared = _sharpest(of, left, rng)
        limit = min(limit, _limit(squared))
        fits = squared < limit
        if fits.sum() < least:
            break
        found.append(part)
        left = left[~fits]
    return found


def _are_finer(parts: Sequence[Array], T_a_b: Array, measured: Correspondences) -> bool:
    """Whether matches fit the nearest of some motions so much better than one for all."""
    whole = measured.squared(T_a_b)
    nearest = np.min([whole, *(measured.squared(T) for T in parts)], 0)
    return bool(whole.mean() > FINER * nearest.mean())


def _is_finer_for_most(part: Array, T_a_b: Array, measured: Correspondences) -> bool:
    """Whether most matches fit a motion so much better than one for all."""
    own, whole = measured.squared(part), measured.squared(T_a_b)
    fits = own < _limit(own)
    return bool(fits.mean() > 0.5 and whole[fits].mean() > FINER * own[fits].mean())


def _sharpest(
    of: Callable[[Matches], Correspondences], matches: Matches, rng: np.random.Generator
) -> tuple[Array, Array]:
    """The motion that a quarter of the matches agrees with most closely, and squared residuals."""
    measured = of(matches)
    T_a_b = measured.sharpest(rng.integers(len(matches), size=(SAMPLES, SAMPLE)), SHARE)
    squared = measured.squared(T_a_b)
    near = matches[squared <= _limit(squared)]
    T_a_b = of(near).refined(T_a_b)[0]
    return T_a_b, measured.squared(T_a_b)


def _limit(squared: Array) -> float:
    """Of squared residuals (M,), by those that agree best."""
    row = int(SHARE * (len(squared) - 1))
    return float(FINE_SIGMAS**2 / CHI_SQUARED * np.partition(squared, row)[row])
