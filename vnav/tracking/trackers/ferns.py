"""Points recognised by random ferns, trained on warped views of one image: 001 section 3.

Source: Ozuysal, Calonder, Lepetit, Fua 2010, "Fast keypoint recognition using random ferns".
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.config import Config
from vnav.core.arrays import Array, Floats
from vnav.core.frame import Features
from vnav.tracking.trackers.grey import grey_of

FERNS, TESTS = 30, 11  # a fern has as many tests as its cells have bits
REACH_PX, BLUR_PX = 16, 1.5  # of a patch of 32 px, and of the image before
VIEWS = 500  # of each point, that are trained
TESTED = 20  # more, by which it is seen how often a point is known again
MAX_TURN_RAD, SCALES = np.deg2rad(30.0), (0.6, 1.5)
GREY_NOISE = 5.0
MIN_KNOWN = 0.5  # share of its views in which a point is known, else it is not sought
MARGIN = np.log(3.0)  # log-posterior of a point over that of the next likely
MARGIN_PX = 40  # of the image: no warped patch reaches farther, nor what is beside the best place
STEP_PX = 2  # between the places that are looked at, but for those beside the best

Words = NDArray[np.uint16]


@dataclass(frozen=True)
class _Trained:
    """Log-probability (N, ferns, cells) of what a fern sees, for each point.

    ``least`` (N,): log-likelihood that a view of the point has; infinite where it is not stable.
    """

    log_p: Floats
    least: Array


class FernsTracker:
    """Looks for the place near its prediction where each point is likeliest.

    A place belongs to the point that is clearly likeliest there. Untrained until it is asked.
    """

    def __init__(self, color: NDArray[np.uint8], features: Features, config: Config) -> None:
        self._color, self._px = color, features.keypoints_px.astype(np.float64)
        self._radius_px, self._seed = config.registration.search_radius_px, config.seed
        rng = np.random.default_rng(config.seed)
        self._pairs = rng.integers(-REACH_PX, REACH_PX, (FERNS, TESTS, 2, 2)).astype(np.float64)
        self._trained: _Trained | None = None

    def find(self, color: NDArray[np.uint8], predicted_px: Array) -> Floats:
        """See `Tracker`."""
        if self._trained is None:
            self._trained = self._train()
        image = _smoothed(color)
        pixels, width = image.reshape(-1), image.shape[1]
        (tests,) = _offsets(self._pairs, np.eye(2)[None], width)
        words = _words(pixels, width, tests, color.shape[1::-1])
        found: Floats = _likeliest(
            *(pixels, width, tests, words, self._trained.log_p, self._trained.least),
            *(np.ascontiguousarray(predicted_px, np.float64), self._radius_px),
        )
        return found + self._fractions

    @property
    def _fractions(self) -> Floats:
        """How far (N, 2) points are beside the pixels that are trained for them."""
        return (self._px - np.rint(self._px)).astype(np.float32)

    def _train(self) -> "_Trained":
        """See how the ferns see each point, from many sides."""
        rng = np.random.default_rng([self._seed, 1])
        image = _smoothed(self._color)
        pixels, width = image.reshape(-1), image.shape[1]
        noise = (GREY_NOISE * np.sqrt(2) * rng.standard_normal(1 << 16)).astype(np.float32)
        tests = _offsets(self._pairs, _warps(rng, VIEWS + TESTED), width)
        x, y = np.rint(self._px).astype(np.int64).T + MARGIN_PX
        log_p: Floats = _log_probabilities(pixels, y * width + x, tests[:VIEWS], noise)
        known, least = _known(pixels, y * width + x, tests[VIEWS:], noise, log_p)
        return _Trained(log_p, np.where(known < MIN_KNOWN, np.inf, least))


def _smoothed(color: NDArray[np.uint8]) -> Floats:
    """Smoothed brightness, its border repeated as far as a warped patch may reach."""
    smooth = cv2.GaussianBlur(grey_of(color).astype(np.float32), (0, 0), BLUR_PX)
    return np.pad(smooth, MARGIN_PX, mode="edge")


def _offsets(pairs: Array, warps: Array, width: int) -> NDArray[np.int64]:
    """How far the pixels of tests (V, M, S, 2) are from a patch's centre in an image's memory."""
    across, down = np.rint(np.einsum("vij,mskj->imskv", warps, pairs)).astype(np.int64)
    return np.ascontiguousarray(np.moveaxis(down * width + across, -1, 0))


def _warps(rng: np.random.Generator, count: int) -> Array:
    """Affine warps (N, 2, 2): ``R(turn) R(-axis) diag(scales) R(axis)``."""
    turn, axis = rng.uniform(-MAX_TURN_RAD, MAX_TURN_RAD, count), rng.uniform(0, 2 * np.pi, count)
    scaled = rng.uniform(*SCALES, (count, 2, 1)) * _turned(axis)
    return np.asarray(_turned(turn) @ _turned(-axis) @ scaled)


def _turned(angle: Array) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], -2)


@compiled
def _log_probabilities(
    image: Floats, centres: NDArray[np.int64], tests: NDArray[np.int64], noise: Floats
) -> Floats:
    """Log of ``(count + 1) / (views + cells)`` for each point, fern and cell.

    ``image`` (H * W,) with a margin, ``centres`` (N,) of the points in it, ``tests``
    (views, ferns, tests, 2): how far from there the two pixels of a test are.
    """
    cells, views = 1 << TESTS, len(tests)
    log_p = np.zeros((len(centres), FERNS, cells), np.float32)
    words, at = np.empty(FERNS, np.uint16), 0
    logs = np.log((np.arange(views + 1) + 1.0) / (views + cells)).astype(np.float32)
    for c in range(len(centres)):
        for k in range(views):
            at = _see(words, image, centres[c], tests[k], noise, at)
            for m in range(FERNS):
                log_p[c, m, words[m]] += 1
        for m in range(FERNS):
            for w in range(cells):
                log_p[c, m, w] = logs[int(log_p[c, m, w])]
    return log_p


@compiled
def _known(
    image: Floats,
    centres: NDArray[np.int64],
    tests: NDArray[np.int64],
    noise: Floats,
    log_p: Floats,
) -> tuple[Array, Array]:
    """In what share of other views each point (N,) is the likeliest, and how likely at least."""
    share, least = np.zeros(len(centres)), np.full(len(centres), np.inf)
    words, at = np.empty(FERNS, np.uint16), 0
    for c in range(len(centres)):
        for k in range(len(tests)):
            at = _see(words, image, centres[c], tests[k], noise, at)
            first, most, _ = _two_likeliest(words, log_p)
            if first == c:
                share[c] += 1 / len(tests)
                least[c] = min(least[c], most)
    return share, least


@compiled
def _see(
    words: Words, image: Floats, centre: int, tests: NDArray[np.int64], noise: Floats, at: int
) -> int:
    """Fill in what the ferns (M,) see about a pixel, with noise; where the next noise is."""
    for m in range(FERNS):
        word = 0
        for s in range(TESTS):
            a = image[centre + tests[m, s, 0]] + noise[at]
            word = 2 * word + (a < image[centre + tests[m, s, 1]])
            at = at + 1 if at + 1 < len(noise) else 0
        words[m] = word
    return at


@compiled
def _words(image: Floats, width: int, tests: NDArray[np.int64], size: tuple[int, int]) -> Words:
    """What the ferns see (H / step, W / step, M) at places a step apart."""
    words = np.zeros((size[1] // STEP_PX, size[0] // STEP_PX, FERNS), np.uint16)
    silent = np.zeros(1, np.float32)
    for i in range(words.shape[0]):
        for j in range(words.shape[1]):
            centre = (i * STEP_PX + MARGIN_PX) * width + j * STEP_PX + MARGIN_PX
            _see(words[i, j], image, centre, tests, silent, 0)
    return words


@compiled
def _likeliest(
    image: Floats,
    width: int,
    tests: NDArray[np.int64],
    words: Words,
    log_p: Floats,
    least: Array,
    predicted: Array,
    radius_px: float,
) -> Floats:
    """Where each point is likeliest (N, 2), NaN where another is there, or nearly."""
    places = np.full((len(predicted), 2), np.nan, np.float32)
    seen, silent = np.empty(FERNS, np.uint16), np.zeros(1, np.float32)
    for c in range(len(predicted)):
        if np.isnan(predicted[c, 0] + predicted[c, 1]) or np.isinf(least[c]):
            continue
        best, at_x, at_y = _likeliest_step(words, log_p[c], predicted[c], radius_px)
        if best == -np.inf:
            continue
        around_x, around_y = at_x, at_y
        for v in range(around_y - 1, around_y + 2):
            for u in range(around_x - 1, around_x + 2):
                _see(seen, image, (v + MARGIN_PX) * width + u + MARGIN_PX, tests, silent, 0)
                told = _log_likelihood(seen, log_p[c])
                if told > best:
                    best, at_x, at_y = told, u, v
        _see(seen, image, (at_y + MARGIN_PX) * width + at_x + MARGIN_PX, tests, silent, 0)
        first, most, next_most = _two_likeliest(seen, log_p)
        if first == c and most - next_most > MARGIN and most >= least[c]:
            places[c, 0], places[c, 1] = at_x, at_y
    return places


@compiled
def _likeliest_step(
    words: Words, log_p: Floats, predicted: Array, radius_px: float
) -> tuple[float, int, int]:
    """The highest log-likelihood of a point among places a step apart, and its pixel."""
    best, at_x, at_y = -np.inf, 0, 0
    (x, y), rows, columns = predicted, words.shape[0], words.shape[1]
    first_i, last_i = int((y - radius_px) / STEP_PX), int((y + radius_px) / STEP_PX)
    first_j, last_j = int((x - radius_px) / STEP_PX), int((x + radius_px) / STEP_PX)
    for i in range(max(first_i, 0), min(last_i + 1, rows)):
        for j in range(max(first_j, 0), min(last_j + 1, columns)):
            if (j * STEP_PX - x) ** 2 + (i * STEP_PX - y) ** 2 > radius_px**2:
                continue
            told = _log_likelihood(words[i, j], log_p)
            if told > best:
                best, at_x, at_y = told, j * STEP_PX, i * STEP_PX
    return best, at_x, at_y


@compiled
def _log_likelihood(words: Words, log_p: Floats) -> float:
    """Of what the ferns see, for one point."""
    total = np.float32(0)
    for m in range(FERNS):
        total += log_p[m, words[m]]
    return float(total)


@compiled
def _two_likeliest(words: Words, log_p: Floats) -> tuple[int, float, float]:
    """The point that is likeliest by what the ferns see, its log-likelihood, and the next one's."""
    first, most, next_most = -1, -np.inf, -np.inf
    for c in range(len(log_p)):
        told = _log_likelihood(words, log_p[c])
        if told > most:
            first, most, next_most = c, told, most
        elif told > next_most:
            next_most = told
    return first, most, next_most
