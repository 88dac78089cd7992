"""The falloff of light from the image centre, by points seen at several distances from it.

Source: Goldman and Chen 2005, "Vignette and exposure calibration and compensation"; Bergmann, Wang
and Cremers 2017, "Online photometric calibration of auto exposure video". Unlike a mean image, the
same surface seen twice does not take what stands in the scene for light.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb

import numpy as np
from scipy.optimize import nnls

from vnav.core.arrays import Array, Rows
from vnav.core.robust import robust_sigma
from vnav.lighting.followed_points import Changes

DEGREE = 5  # of the profile's logarithm, in the square of the distance
JUDGED_R = 0.75  # three quarters of the way to the corners: points are many up to there
STRONG = 0.87  # brightness left there from which maps are harmed: docs/log.md
SURE = 4.0  # standard deviations
LEAST_PLACES = 8  # of the capture, else nothing is known of how surely the profile is
ROUNDS = 10  # of reweighting
MOST_SLACK = 10.0  # by which standard deviations grow as weights follow the fit
LEAST_SIGMA = 1e-3  # of a logarithm of brightness: less is no noise of a camera

Changed = Sequence[Changes]  # of the pairs of frames of one place of the capture


@dataclass(frozen=True)
class LightProfile:
    """How bright an evenly lit surface looks, 1 at the image centre and never rising outwards.

    ``drops`` (DEGREE,) are what the logarithm's Bernstein coefficients fall by, none negative;
    ``covariance`` (DEGREE, DEGREE) is theirs.
    """

    drops: Array
    covariance: Array

    def brightness(self, r2: Array | float) -> Array:
        """Where the square of the distance from the centre is r2 (...): 1 in the corners."""
        return np.exp(-_basis(np.asarray(r2, np.float64)) @ self.drops)

    def sigma(self, r2: float) -> float:
        """Standard deviation of the logarithm of the brightness there."""
        row = _basis(np.array(r2))
        return float(np.sqrt(row @ self.covariance @ row))

    @property
    def is_strong(self) -> bool:
        """Whether it surely falls off by so much that it harms maps."""
        judged = JUDGED_R**2
        return bool(np.log(self.brightness(judged)) + SURE * self.sigma(judged) < np.log(STRONG))


def fitted(places: Sequence[Changed]) -> LightProfile | None:
    """The profile that explains best how points changed, and how surely; None from too few places.

    Exposure between two frames is free. Points of a place err alike, so that the covariance is
    that of leaving out one place at a time (jackknife), as if drops might be negative.
    """
    seen = [place for place in places if len(place)]
    if len(seen) < LEAST_PLACES:
        return None
    normal, right, slack = _reweighted([pair for place in seen for pair in place])
    of_place = np.repeat(np.arange(len(seen)), [len(place) for place in seen])
    drops = _solved(normal.sum(0), right.sum(0))
    return LightProfile(drops, slack**2 * _jackknife(normal, right, of_place))


def _jackknife(normal: Array, right: Array, of_place: Rows) -> Array:
    """Covariance (D, D) of the drops by leaving out the pairs of one place at a time."""
    total, sums, count = normal.sum(0), right.sum(0), of_place[-1] + 1
    without = []
    for k in range(count):
        own = of_place == k
        rest = _definite(total - normal[own].sum(0))
        without.append(np.linalg.solve(rest, sums - right[own].sum(0)))
    off = np.array(without) - np.mean(without, 0)
    return np.asarray((count - 1) / count * off.T @ off)


def _basis(r2: Array) -> Array:
    """How much of each drop (..., DEGREE) has come at r2 (...): sums of Bernstein polynomials."""
    k = np.arange(DEGREE + 1)
    chosen = np.array([comb(DEGREE, i) for i in k])
    bernstein = chosen * r2[..., None] ** k * (1 - r2[..., None]) ** (DEGREE - k)
    return np.asarray(np.cumsum(bernstein[..., ::-1], -1)[..., -2::-1])


def _reweighted(pairs: Sequence[Changes]) -> tuple[Array, Array, float]:
    """Normal equations (P, D, D) and (P, D) of each pair, outliers weighted down.

    Weights of Geman and McClure, by the residuals' robust spread; exposures are eliminated. And how
    many times as far drops move as these equations say, as weights move with them (Huber 1981).
    """
    rows = [_basis(pair.r2_a) - _basis(pair.r2_b) for pair in pairs]
    drops, gains = np.zeros(DEGREE), [float(np.median(pair.log_ratio)) for pair in pairs]
    for _ in range(ROUNDS):
        zipped = zip(pairs, rows, gains, strict=True)
        off = [pair.log_ratio - row @ drops - gain for pair, row, gain in zipped]
        spread = 2 * max(float(robust_sigma(np.concatenate(off))), LEAST_SIGMA)
        weights = [(1 + (o / spread) ** 2) ** -2.0 for o in off]
        weighted = zip(pairs, rows, weights, strict=True)
        terms = [_pair_terms(row, pair.log_ratio, weight) for pair, row, weight in weighted]
        normal, right = (np.array([term[k] for term in terms]) for k in (0, 1))
        drops = _solved(normal.sum(0), right.sum(0))
        gains = [float(mean_y - mean_x @ drops) for _, _, mean_x, mean_y in terms]
    weight = np.concatenate(weights)
    slope = weight * (4 * np.sqrt(weight) - 3)  # of the weighted residual, by the residual
    return normal, right, float(min(weight.sum() / max(slope.sum(), 1e-9), MOST_SLACK))


def _pair_terms(x: Array, y: Array, weight: Array) -> tuple[Array, Array, Array, Array]:
    """Normal equations of a pair without its exposure, and its weighted means."""
    mean_x, mean_y = weight @ x / weight.sum(), np.asarray(weight @ y / weight.sum())
    weighted = weight[:, None] * (x - mean_x)
    return weighted.T @ (x - mean_x), weighted.T @ (y - mean_y), mean_x, mean_y


def _solved(normal: Array, right: Array) -> Array:
    """The drops that fit best of those that are not negative."""
    root = np.linalg.cholesky(_definite(normal))
    return np.asarray(nnls(root.T, np.linalg.solve(root, right))[0])


def _definite(normal: Array) -> Array:
    """Normal equations that can be solved although points tell of some drops only."""
    return np.asarray(normal + (1e-9 * np.trace(normal) / DEGREE + 1e-12) * np.eye(DEGREE))
