"""Places that look alike, compared by all pixels of the photo.

The features of what repeats itself match in every place that has it. What tells the places apart
may be plain, or a small part of the photo: only what the map's keyframes show from each place says
so. A photo from outside of the map may look alike, too: then nothing explains it in each cell.
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from vnav.core.arrays import Array
from vnav.core.map_index import MapIndex
from vnav.localisation.pixels import Pixels
from vnav.localisation.verification.evidence import Beta, log_beta_binomial
from vnav.localisation.verification.pixel_cells import misfits, noise
from vnav.localisation.verification.rendering import (
    StandingPoints,
    rendered,
    standing_points,
)
from vnav.localisation.verification.verify import VerifiedPose

MOST = 12  # places that are compared: the likeliest
KEPT = 32  # keyframes, which near places share
DIFFERS = 0.2  # share of the pixels of a cell from which on it differs
LESS = 1 / 3  # of another place's share: a place that explains the cell better
RIGHT: Beta = (0.3, 12.0)  # of the cells that tell, the share that the right place leaves open
OUTSIDE: Beta = (3.0, 2.0)  # the same of a place that looks alike, where the right one is unmapped
UNMAPPED = 0.25  # odds of that at least, before the pixels are asked


def compared(
    places: Sequence[VerifiedPose], chances: Sequence[float], index: MapIndex, pixels: Pixels
) -> Array:
    """Probability (P,) of two places or more, the likeliest first: by all pixels, too."""

    @lru_cache(KEPT)
    def points_of(number: int) -> StandingPoints:
        return standing_points(pixels.keyframe(number), number, index)

    photo = pixels.photo
    views = [rendered(place.view, photo, index, points_of) for place in places[:MOST]]
    sigma = noise(photo, views)
    odds = likelihoods(np.stack([misfits(photo, view, sigma) for view in views]))
    weights = np.array(chances, float)
    outside = max(UNMAPPED * weights.sum(), 1 - weights.sum()) * odds[-1]
    weights[: len(views)] *= odds[:-1]
    return np.asarray(weights / (weights.sum() + outside))


def likelihoods(open_share: Array) -> Array:
    """Likelihood of each place (P,), and that the photo is from outside, over the best place's.

    ``open_share`` (P, R, C): of the pixels of each cell that a place does not explain.
    """
    better = np.array([[_better(one, other) for other in open_share] for one in open_share])
    best = 0
    for place in range(1, len(better)):
        if better[place, best] > better[best, place]:
            best = place
    ours, theirs = better[best], better[:, best]
    logs = log_beta_binomial(ours, ours + theirs, RIGHT)
    logs -= log_beta_binomial(theirs, ours + theirs, RIGHT)
    left = np.array((open_share[best] > DIFFERS).sum())
    told = left + np.delete(ours, best).min()
    outside = log_beta_binomial(left, told, OUTSIDE) - log_beta_binomial(left, told, RIGHT)
    return np.exp([*logs, outside])


def _better(one: Array, other: Array) -> int:
    """Cells that one place explains, and the other does not."""
    return int(((other > DIFFERS) & (one < LESS * other)).sum())
