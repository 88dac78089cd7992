"""Candidate motions between two frames, weighed by all their pixels with depth, or all.

A pixel's point, carried into the other frame, should meet a surface there that looks the same. A
point before that surface is seen through, which speaks against the motion; one behind it is hidden,
and says nothing. Where few have depth, the others are asked by their brightness. What repeats or
moves agrees with itself in a part of the image only, so a cell of the image has one vote, however
many pixels it has. Source for the comparison of two hypotheses by how evenly parts of the data
prefer one: Vuong 1989, "Likelihood ratio tests for model selection".
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations
from math import ceil, erfc, log, sqrt

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.arrays import Array, Floats, Rows
from vnav.core.camera import Intrinsics
from vnav.core.reduced_frame import BLOCK_PX, ReducedFrame
from vnav.registration.cell_votes import poll
from vnav.registration.far_evidence import far_log_likelihoods, met_far
from vnav.registration.pixel_evidence import (
    DEPTH_DELAY_SIGMA_S,
    LINE_DELAY_SIGMA_S,
    SEEN_SIGMAS,
    carried,
    exposure,
    lateness,
    log_likelihoods,
    put_alike,
)

CELLS = 12, 16  # down and across
MAX_SAMPLES = 3000  # pixels of a frame that are asked
CORRELATED = 9.0  # pixels of a reduced frame that err alike: so many count for one
WRONG = 0.05  # share of pixels that a right motion does not explain, and of cells
GREY_SIGMA = 3.0  # of a block's brightness: by noise, and by reflections, which do not average out
SAME = 0.25  # of what an inlier may be off: where two motions are one
BLUR_PX = 1.0  # of the brightness, which is interpolated
AFAR_BLOCKS = 2.0  # by which two motions put most pixels elsewhere: what then fits both repeats
TINY = 1e-12
MOST_VIEWS = 8  # that are kept: a frame is held against few others, which others are, too
CLEAR = 4.6  # log-odds of 99 to 1; what is less clear is a tie
MAX_Z = 20.0  # sums of votes in standard deviations; more does not fit a number


@dataclass(frozen=True)
class PixelEvidence:
    """What pixels say of C candidate motions, and of there being none, which is the last.

    ``favour`` (C + 1, C + 1): votes of cells for the row's candidate against the column's, as
    log-likelihood ratios; ``variance`` of these sums, by how much the cells disagree.
    ``refuting`` (C,): share of the cells that show other things than a candidate has there.
    """

    favour: Array
    variance: Array
    refuting: Array

    def __add__(self, other: "PixelEvidence") -> "PixelEvidence":
        """With that of another pair of frames on the same candidates; the larger share refutes."""
        favour, variance = self.favour + other.favour, self.variance + other.variance
        return PixelEvidence(favour, variance, np.maximum(self.refuting, other.refuting))

    @property
    def log_odds(self) -> Array:
        """Of each candidate against each (C + 1, C + 1), none being the last."""
        z = self.favour / np.sqrt(np.maximum(self.variance, TINY))
        return np.reshape([_log_odds(value) for value in z.flat], z.shape)

    @property
    def probabilities(self) -> Array:
        """That each candidate (C,) is right; what they leave is the probability that none is."""
        return self.posterior(np.zeros(len(self.favour) - 1))

    def posterior(self, log_prior: Array) -> Array:
        """The same, of candidates that are not alike likely; none is as likely as the best."""
        prior = np.append(log_prior, log_prior.max())
        log_odds = self.log_odds + prior[:, None] - prior
        against_all = 1 / np.exp(np.minimum(log_odds, 700).T).sum(1)
        return np.asarray(against_all / against_all.sum())[:-1]


def judge(
    a: ReducedFrame,
    b: ReducedFrame,
    candidates: Sequence[Array],
    config: RegistrationConfig,
    *,
    follow: bool = False,
) -> PixelEvidence:
    """The evidence of the pixels of two frames on motions ``T_a_b`` between them.

    Both ways: a's pixels are held against b, and b's against a. No preference where nothing
    overlaps. Candidates that pixels cannot tell apart had better be one: see `are_same`. A camera
    that moves sees its depth late, and its rows one after the other: delays that are not known
    yet are noise, as large as the frames' twists make it. ``follow``: whether one frame follows
    the other, so that both see much of the same: then what only one motion explains counts, too,
    and of two that are far apart, what both explain counts less. Else a motion may be right under
    which they see nothing of the same.
    """
    of_a, of_b = _View.of(a), _View.of(b)
    inverses = [se3.inverse(T) for T in candidates]
    there = _votes(of_a, of_b, inverses, config, follow)
    back = _votes(of_b, of_a, candidates, config, follow)
    both = there + back  # what one way tells, the other tells again
    return replace(both, favour=both.favour / 2, variance=both.variance / 2)


def refuted(
    a: ReducedFrame, b: ReducedFrame, T_a_b: Array, config: RegistrationConfig
) -> NDArray[np.bool_]:
    """Blocks (H, W) of b, by cells, that show other things than a motion has there.

    Chance explains what such a cell's pixels meet in a better.
    """
    cells = _refuting(_told(_View.of(b), _View.of(a), [T_a_b], config), _cells(b.intrinsics))[0]
    v, u = np.mgrid[: b.intrinsics.height, : b.intrinsics.width]
    return np.asarray(cells[_cell_at(v, u, b.intrinsics)])


def are_same(
    a: ReducedFrame, T_a_b: Array, U_a_b: Array, config: RegistrationConfig, delay_s: float = 0.0
) -> bool:
    """Whether two motions put most of a's pixels with depth at one place in b, but for noise.

    Also those that are apart by no more than what the camera moves within ``delay_s``.
    """
    pixels, camera = _grid(a.intrinsics, MAX_SAMPLES // 8)[0], a.intrinsics.pinhole
    limits = SAME * config.ransac_threshold_px / BLOCK_PX, SEEN_SIGMAS * config.depth_sigma_per_m2
    motions = np.stack([T_a_b, U_a_b]), delay_s * a.twist
    return bool(put_alike(*motions, a.inverse_depth, camera, pixels, np.array(limits)) >= 0.5)


@dataclass(frozen=True)
class _View:
    """A reduced frame as the loops take it, and which of its pixels are asked.

    ``image`` (H, W, 2): inverse depth, and brightness smoothed so that it can be interpolated;
    ``spread`` (2,): their standard deviations; ``camera`` (10,): fx, fy, cx, cy, then the twist;
    ``pixels`` (N, 2), how ``late`` (N, 3) they are, their ``brightness`` and ``cells`` (N,); mean
    ``surface`` of the cells (R, C), 0 where unknown; which pixels are ``far``, without depth.
    """

    image: Floats
    spread: Array
    camera: Array
    pixels: NDArray[np.int64]
    late: Array
    weight: float
    brightness: Array
    cells: NDArray[np.int64]
    surface: Array
    far: Rows
    lacks_depth: bool

    @classmethod
    @lru_cache(MOST_VIEWS)
    def of(cls, frame: ReducedFrame) -> "_View":
        """Made ready, once while it is asked again and again."""
        grey = cv2.GaussianBlur(np.asarray(frame.grey), (0, 0), BLUR_PX)
        image = np.stack([frame.inverse_depth, grey], -1)
        pixels, stride = _grid(frame.intrinsics, MAX_SAMPLES)
        u, v = pixels.T
        inverse_depth, brightness = image[v, u].astype(float).T
        cells = _cells(frame.intrinsics)
        known = inverse_depth > 0
        spread = inverse_depth[known].std() if known.any() else 0.0
        total, count = (np.bincount(cells, k, CELLS[0] * CELLS[1]) for k in (inverse_depth, known))
        surface = (total / np.maximum(count, 1)).reshape(CELLS)
        camera = np.concatenate([frame.intrinsics.pinhole, frame.twist])
        late, weight = lateness(image, camera, pixels), stride**2 / CORRELATED
        spreads = np.array([spread, brightness.std()])
        far = np.flatnonzero(~known if frame.masked is None else ~(known | frame.masked[v, u]))
        asked = pixels, late, weight, brightness, cells, surface, far, frame.lacks_depth
        return cls(image, spreads, camera, *asked)


def _votes(
    a: _View, b: _View, T_b_a: Sequence[Array], config: RegistrationConfig, follow: bool
) -> PixelEvidence:
    """How a's cells vote, by what their pixels meet in b; see `poll`."""
    told = _told(a, b, T_b_a, config)
    afar = _afar(a, T_b_a) if follow else np.zeros((len(told), len(told)), bool)
    favour, variance = poll(told, a.cells, a.surface, a.weight, WRONG, follow, afar)
    return PixelEvidence(favour, variance, _refuting(told, a.cells).mean(1))


def _afar(a: _View, T_b_a: Sequence[Array]) -> NDArray[np.bool_]:
    """Which of the motions, and chance (C + 1, C + 1), have most of a's pixels in other places."""
    T_a_b, count = se3.inverse(np.array(T_b_a)), len(T_b_a)
    inverse_depth = np.ascontiguousarray(a.image[..., 0])
    pixels = np.ascontiguousarray(a.pixels[::8])
    limits, afar = np.array([AFAR_BLOCKS, np.inf]), np.zeros((count + 1, count + 1), bool)
    for i, j in combinations(range(count), 2):
        alike = put_alike(T_a_b[[i, j]], np.zeros(6), inverse_depth, a.camera[:4], pixels, limits)
        afar[i, j] = afar[j, i] = alike < 0.5
    return afar


def _told(a: _View, b: _View, T_b_a: Sequence[Array], config: RegistrationConfig) -> Array:
    """Log-likelihoods (C + 1, N) of what a's pixels meet in b, over chance, which is the last."""
    delays = DEPTH_DELAY_SIGMA_S, BLOCK_PX * LINE_DELAY_SIGMA_S
    place = config.pixel_sigma_px / BLOCK_PX
    sigmas = np.array([place, config.depth_sigma_per_m2, GREY_SIGMA, *delays])
    cameras, chance = np.stack([a.camera, b.camera]), np.hypot(a.spread, b.spread)
    far = a.far if a.lacks_depth or b.lacks_depth else a.far[:0]
    told = np.zeros((len(T_b_a) + 1, len(a.pixels)))
    for k, T in enumerate(T_b_a):
        T = np.ascontiguousarray(T)
        met = carried(T, a.image, b.image, cameras, a.pixels, a.late, sigmas)
        met_beyond = met_far(T, b.image, cameras, a.pixels[far], sigmas)
        met[far, 1], met[far, 3] = met_beyond[:, 0].T  # for the exposure: as if infinitely far
        met[far, 5] = 0.0
        light = exposure(met, a.brightness, chance[1])
        told[k] = log_likelihoods(met, a.brightness, light, chance, WRONG)
        beyond = met_beyond, a.brightness[far], a.cells[far]
        told[k, far] = far_log_likelihoods(*beyond, light, chance[1], WRONG)
    return told


def _refuting(told: Array, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which cells (C, R * C) refute each candidate, by the log-likelihoods (C + 1, N) of pixels."""
    size = CELLS[0] * CELLS[1]
    sums = [np.bincount(cells, of_pixels, size) for of_pixels in np.nan_to_num(told[:-1])]
    return np.reshape(sums, (-1, size)) < 0


@lru_cache(MOST_VIEWS)
def _grid(camera: Intrinsics, count: int) -> tuple[NDArray[np.int64], int]:
    """At most so many pixels (N, 2), u and v, of an even grid, and the step between them."""
    stride = ceil(sqrt(camera.width * camera.height / count))
    rows, columns = np.arange(0, camera.height, stride), np.arange(0, camera.width, stride)
    return np.stack(np.meshgrid(columns, rows), -1).reshape(-1, 2).astype(np.int64), stride


@lru_cache(MOST_VIEWS)
def _cells(camera: Intrinsics) -> NDArray[np.int64]:
    """The number (N,) of the cell that each asked pixel is in."""
    u, v = _grid(camera, MAX_SAMPLES)[0].T
    return _cell_at(v, u, camera)


def _cell_at(v: Rows, u: Rows, camera: Intrinsics) -> NDArray[np.int64]:
    """The number of the cell that a pixel is in."""
    return np.asarray(v * CELLS[0] // camera.height * CELLS[1] + u * CELLS[1] // camera.width)


def _log_odds(z: float) -> float:
    """Of a standard normal value being below z."""
    z = min(max(z, -MAX_Z), MAX_Z)
    return log(erfc(-z / sqrt(2)) / erfc(z / sqrt(2)))
