"""How far edges of depth lie from edges of colour: a wrong registration of depth shows here.

Depth of most sensors makes near things wider or narrower, to all sides alike. So the edges to the
right and to the left of them are sought apart: the middle of the two is the shift, half of what is
between them the widening, which upper edges are freed of. Lower edges are not used: where a table
or a shelf ends, colour has two, of its plate and of its rim.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.checking.depth_edges import depth_edges
from vnav.core.arrays import Array
from vnav.core.frame import Frame

REACH = 1 / 32  # of the image's width, to either side: 20 px at 640
WIDENED = 1 / 128  # at most, of the image's width: to each side
LEAST_STEP = 4.0  # of 255 levels a pixel: weaker edges of colour are noise
FEWEST_EDGES = 500  # to each side, over all frames
DRAWS, SEED = 100, 0  # of frames, to see how much the shift depends on which there are
WHOLE_PX = 12**-0.5  # standard deviation of edges that are told in whole pixels
VAGUE = 1 / 400  # of the image's width: a standard deviation beyond it says nothing


@dataclass(frozen=True)
class DepthShift:
    """How far depth lies to the right of colour, and below it, in pixels; standard deviations.

    ``width``: of the images.
    """

    px: tuple[float, float]
    sigma_px: tuple[float, float]
    width: int


@dataclass(frozen=True)
class EdgeProfiles:
    """Steps of colour across the edges of depth in a frame.

    ``sums`` (3, 2 R + 1): to the right, to the left and above of what is near, at -R to R pixels,
    over ``count`` (3,) edges, in shares of an edge's largest step. ``width``: of the image.
    """

    sums: Array
    count: Array
    width: int


def edge_profiles(frame: Frame) -> EdgeProfiles:
    """What a frame tells of how depth lies on colour."""
    return profiles_across(depth_edges(frame.depth_m), frame.color)


def profiles_across(edges: NDArray[np.bool_], color: NDArray[np.uint8]) -> EdgeProfiles:
    """Of edges (4, H, W) as of `depth_edges`, on colour (H, W, 3)."""
    width = color.shape[1]
    reach = max(2, round(REACH * width))
    gray = cv2.cvtColor(np.asarray(color), cv2.COLOR_RGB2GRAY).astype(np.float32)
    gray = np.asarray(cv2.GaussianBlur(gray, (0, 0), max(1.0, width / 640)), np.float32)
    looks = (gray, edges[0], 0), (gray, edges[1], 1), (gray.T, edges[3].T, 1)
    found = [_profiles(*look, reach) for look in looks]
    return EdgeProfiles(
        np.array([sums for sums, _ in found]), np.array([count for _, count in found]), width
    )


def _profiles(
    gray: NDArray[np.float32], edges: NDArray[np.bool_], before: int, reach: int
) -> tuple[Array, int]:
    """Sum (2 R + 1,) over the edges of rows, and their number; ``before`` the pixel, or after."""
    steps = np.abs(np.diff(gray, axis=1))
    row, column = np.nonzero(edges)
    column = column - before
    whole = (column >= reach) & (column + reach < steps.shape[1])
    at = column[whole, None] + np.arange(-reach, reach + 1)
    profiles = steps[row[whole, None], at]
    largest = profiles.max(1, initial=0)
    clear = largest > LEAST_STEP
    return (profiles[clear] / largest[clear, None]).sum(0, dtype=float), int(clear.sum())


def depth_shift(profiles: Sequence[EdgeProfiles]) -> DepthShift | None:
    """The shift that frames agree on; None where there are too few edges, or it is not clear."""
    profiles = [each for each in profiles if each.width == profiles[0].width]
    if not profiles:
        return None
    sums = np.array([each.sums for each in profiles])
    counts = np.array([each.count for each in profiles], float)
    width = profiles[0].width
    if counts.sum(0).min() < FEWEST_EDGES:
        return None
    drawn = draws(len(profiles))
    varied = np.std([_shift(sums[rows], counts[rows], width) for rows in drawn], axis=0)
    sigma = np.hypot(varied, WHOLE_PX)
    if sigma.max() > VAGUE * width:
        return None
    return DepthShift(_shift(sums, counts, width), (float(sigma[0]), float(sigma[1])), width)


def draws(count: int) -> NDArray[np.intp]:
    """So many frames, drawn `DRAWS` times with replacement (DRAWS, count): the bootstrap."""
    return np.random.default_rng(SEED).integers(0, count, (DRAWS, count))


def _shift(sums: Array, counts: Array, width: int) -> tuple[float, float]:
    right, left, above = sums.sum(0) / np.maximum(counts.sum(0), 1)[:, None]
    at = np.arange(len(right))
    both = right[:, None] + left
    both[np.abs(at[:, None] - at) > 2 * WIDENED * width] = -np.inf
    ends, begins = np.unravel_index(both.argmax(), both.shape)
    of_right, of_left = _vertex(right, int(ends)), _vertex(left, int(begins))
    of_above = _vertex(above, int(above.argmax())) + (of_right - of_left) / 2
    here = (len(at) - 1) / 2
    return here - (of_right + of_left) / 2, here - of_above


def _vertex(profile: Array, k: int) -> float:
    """The top of the parabola through three values, within half a pixel of k."""
    if not 0 < k < len(profile) - 1:
        return float(k)
    left, top, right = profile[k - 1 : k + 2]
    bend = left - 2 * top + right
    return k + float(np.clip((left - right) / (2 * bend), -0.5, 0.5)) if bend < 0 else float(k)
