"""How much more likely a photo shows what it shows if it was taken at a pose than if it was not.

The image is cut into cells. In each, the map predicts landmarks, of which the photo shows some. A
cell either looks as predicted, and then a share of its landmarks is found, or it does not (the pose
is wrong, or something stands there now, or it is too dark), and then next to none is. How large the
share is depends on camera, exposure and map, not on the place: it is the photo's own, unknown, and
integrated out; a small one is rare, and what chance matches make of a wrong pose. Nearly all cells
of a right pose look as predicted; of a rival, a place of the map that repeats things (windows,
shelves), perhaps half of them do; in a map that does not hold the place, hardly any, but there the
pose is the best of many tries. How many is told by three distributions of the share of cells, which
is integrated out, too: cells of one photo stand and fall together. Where the map repeats itself,
a place that it does not hold may look like a rival, too.

Most constants are fitted on synthetic scenes; docs/evidence.md names the four set by hand, and
benchmarks/calibrate_confidence.py checks all of them, and fits them anew.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array
from vnav.core.descriptor_space import DescriptorSpace
from vnav.localisation.verification.image_cells import MIN_COUNT

Beta = tuple[float, float]

SHARES = (np.arange(20) + 0.5) / 20  # of cells
RATES = np.geomspace(0.04, 0.7, 12)  # of landmarks found, where a photo looks as predicted
RATE_BETA = (3.0, 5.0)  # Beta parameters of that rate over photos
RATE_PRIOR = RATES ** RATE_BETA[0] * (1 - RATES) ** (RATE_BETA[1] - 1)  # their steps grow with them
LOG_PRIOR = np.log(RATE_PRIOR / RATE_PRIOR.sum())
TRIES = 5.0  # poses that the best one is chosen from where none is right
RIVALS = 0.002  # share of places that look like another one, where the map tells nothing else
UNMAPPED = 0.5  # as often an unmapped place looks like one of the map as another one of the map


@dataclass(frozen=True)
class Odds:
    """Beta parameters: of the share of landmarks found in a cell, and of the share of cells.

    Where a cell looks as predicted, ``concentration`` is the sum of the parameters; their mean is
    the photo's rate.
    """

    concentration: float = 15.0
    found_if_not: Beta = (0.13, 18.0)
    cells_if_right: Beta = (7.9, 0.28)
    cells_of_rival: Beta = (0.87, 2.0)
    cells_elsewhere: Beta = (0.5, 12.0)


ODDS = {  # by front-end
    "sift": Odds(),
    "orb": Odds(10.5, (0.033, 19.4), (18.0, 0.23), (5.7, 3.9)),
    "brisk": Odds(14.6, (0.16, 14.9), (8.0, 0.26), (1.0, 4.6)),
    "fast": Odds(11.2, (0.36, 10.8), (3.7, 0.3), (1.3, 1.25)),
}


@dataclass(frozen=True)
class Evidence:
    """Log likelihoods (nats) of what a photo shows at a pose, were it right, or a rival's.

    ``elsewhere``: were the photo from a place that is not like it. Each for every one of RATES
    (R,).
    """

    right: Array
    rival: Array
    elsewhere: Array

    @property
    def strength(self) -> float:
        """How much (nats) it speaks for the pose rather than for a rival."""
        return float(_log_sum(self.right + LOG_PRIOR) - _log_sum(self.rival + LOG_PRIOR))

    @property
    def likeness(self) -> float:
        """Probability that the place looks like the photo's, if it is another one."""
        rival, elsewhere = (float(_log_sum(e + LOG_PRIOR)) for e in (self.rival, self.elsewhere))
        return 1 / (1 + (1 / RIVALS - 1) * float(np.exp(min(elsewhere - rival, 100.0))))


def odds_of(space: DescriptorSpace) -> Odds:
    """Those of a front-end; SIFT's of one that none were fitted for."""
    return ODDS.get(space.front_end, ODDS["sift"])


def evidence(cells: NDArray[np.intp], odds: Odds = Odds()) -> Evidence:
    """What the landmarks found and predicted (2, C) in each cell tell; none predicted: nothing."""
    k, n = cells[:, cells[1] >= MIN_COUNT]
    otherwise = log_beta_binomial(k, n, odds.found_if_not)
    total = odds.concentration
    predicted = np.stack([log_beta_binomial(k, n, (r * total, (1 - r) * total)) for r in RATES])
    share = SHARES[:, None, None]
    mixed = np.logaddexp(np.log(share) + predicted, np.log(1 - share) + otherwise)
    of_share = mixed.sum(2)  # (shares, rates)
    kinds = odds.cells_if_right, odds.cells_of_rival, odds.cells_elsewhere
    return Evidence(*(_log_sum(of_share + _log_weights(b)[:, None]) for b in kinds))


def posterior(places: Sequence[Evidence], odds: Array | float = 1.0) -> Array:
    """Probability (P,) of each place that the photo was taken there.

    Either one place is right and the others are rivals, or none is. 0 places are legal. ``odds``
    (P,): how much likelier a right pose is there than a chance one, by anything else.
    """
    if not places:
        return np.zeros(0)
    rivals = np.sum([place.rival for place in places], axis=0)
    log_odds = np.broadcast_to(np.log(odds), len(places))
    right = [p.right - p.rival + prior for p, prior in zip(places, log_odds, strict=True)]
    strongest = int(np.argmax([place.strength for place in places]))
    none = _unmapped(places, strongest) - places[strongest].rival + np.log(TRIES)
    scores = _log_sum((rivals + np.stack([*right, none]) + LOG_PRIOR).T)
    return np.asarray(np.exp(scores - _log_sum(scores))[:-1])


def _unmapped(places: Sequence[Evidence], k: int) -> Array:
    """Log likelihood (R,) of what place k shows, were the photo from outside of the map.

    Then the place is like none there, or a rival: the likelier, the more of the map's others are.
    """
    alike = sum(place.likeness for place in [*places[:k], *places[k + 1 :]])
    chance = max(RIVALS, UNMAPPED * alike / (1 + alike))
    like_none, rival = places[k].elsewhere + np.log1p(-chance), places[k].rival + np.log(chance)
    return np.asarray(np.logaddexp(like_none, rival))


def log_beta_binomial(k: NDArray[np.intp], n: NDArray[np.intp], beta: Beta) -> Array:
    """Log probability of k out of n, but for the binomial coefficient, which cancels."""
    a, b = beta
    rising = [_log_rising(start, int(n.max(initial=0))) for start in (a, b, a + b)]
    return np.asarray(rising[0][k] + rising[1][n - k] - rising[2][n])


def _log_rising(start: float, last: int) -> Array:
    """Log of start (start + 1) ... (start + k - 1), for k = 0 ... last."""
    return np.append(0.0, np.cumsum(np.log(start + np.arange(last))))


def _log_weights(beta: Beta) -> Array:
    weights = (beta[0] - 1) * np.log(SHARES) + (beta[1] - 1) * np.log(1 - SHARES)
    return np.asarray(weights - _log_sum(weights))


def _log_sum(logs: Array) -> Array:
    """Log of the sum of the exponentials along the first axis."""
    most = logs.max(0)
    return np.asarray(most + np.log(np.exp(logs - most).sum(0)))
