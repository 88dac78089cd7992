"""How many views see through a surface that one view sees, and how many see it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Floats
from vnav.masking.view import Blocks, PosedView

MIN_Z_M = 0.05  # nothing is seen nearer than this
SIGMAS = 4.0  # of the difference of two depths, that are not noise
MEDIAN_OF_SIGMA = 0.6745  # median absolute value of noise whose deviation is 1
FITS = 3.0  # times the noise of two depths, by which views differ that fit, of a real sensor
COARSE = 2  # a region that is opened has a block of every so many rows and columns
STRIDE = 2 * COARSE  # between the blocks that tell how well two views fit
MIN_FITTED = 30  # such blocks
ENOUGH = 1.0  # views that fit, or more that fit worse, see through what is not there
MAX_DELAY_S = 0.03  # of depth after colour, where nobody knows it
SAME, FREE = range(2)

Projection = tuple[float, ...]  # of 12


@dataclass(frozen=True)
class Votes:
    """Of each block (h, w): how many views see its surface, and how many see through it.

    A view that fits counts for one; of those that fit worse, more are needed to see through it.
    """

    same: Floats
    free: Floats

    @property
    def seen_through(self) -> Blocks:
        """Blocks (h, w) whose surface is not there in other views, by enough of them."""
        return np.asarray(self.free >= ENOUGH)


def count_votes(
    view: PosedView,
    others: Sequence[PosedView],
    sigma_per_m2: float,
    margin_m: float,
    step: int = 1,
) -> Votes:
    """Hold a view's surfaces against what others measured where they fall.

    A surface is seen through where a view has measured depth in a block and all about it, all
    farther by more than the noise and the margin: a misalignment of one block changes nothing.
    Where cameras turn, late depth may misalign more blocks, and so many about it must be farther.
    The noise is the sensor's, or more where most surfaces that both see differ by more: then a pose
    is not exact. A view in which hardly a surface is in its place has no vote, for its pose is
    wrong; unless the view's own is, which fits most of those before as little as most of those
    after. None has a vote where it has no depth, where something hides the surface, and beyond the
    image. Views have one camera; none give no votes. With a step, 1 or `COARSE`, only blocks of
    every so many rows and columns are asked; they have the same votes.
    """
    votes = np.zeros((2, *view.frame.grey.shape), np.float32)
    sigma = np.sqrt(2) * sigma_per_m2
    fallen = [places_in(other, view, step) for other in others]
    told = [_noise(*at, o, sigma, margin_m) for at, o in zip(fallen, others, strict=True)]
    noises, shared = np.array(told).reshape(-1, 2).T
    fits = np.isfinite(noises)
    is_later = np.array([other.stamp_s > view.stamp_s for other in others], bool)
    tells = shared >= MIN_FITTED
    is_own_wrong = not (_most(fits[tells & is_later]) or _most(fits[tells & ~is_later]))
    for k in range(len(others)):
        if not (fits[k] or is_own_wrong):
            continue
        noise = max(sigma, noises[k]) if fits[k] else sigma
        weight = min(1.0, (FITS * sigma / noise) ** 2)
        near = others[k].about(1 + _late_blocks(view, others[k]))
        asked = *fallen[k], near.nearest, near.farthest, near.clear
        _add_votes(votes, weight, *asked, SIGMAS * noise, margin_m, step)
    return Votes(votes[SAME], votes[FREE])


def _most(fits: Blocks) -> bool:
    """Whether most of some views (N,) fit; none do not."""
    return len(fits) > 0 and 2 * int(fits.sum()) >= len(fits)


def misfit(view: PosedView, other: PosedView, sigma_per_m2: float, margin_m: float) -> float:
    """Standard deviation of two views' inverse depth, where both see one surface.

    Of most of these surfaces, by the median; of noise, if the poses are right. Infinite where they
    share too few: a pose is wrong, or they do not see one place. ``sigma_per_m2`` of either, and
    the margin, tell what is one surface.
    """
    places, expected = places_in(other, view, STRIDE)
    return _noise(places, expected, other, np.sqrt(2) * sigma_per_m2, margin_m)[0]


def _noise(
    places: NDArray[np.int32], expected: Floats, other: PosedView, sigma: float, margin_m: float
) -> tuple[float, int]:
    """See `misfit`, and blocks that both might see; ``sigma`` of the difference of two depths."""
    near = other.about(1)
    depths = other.frame.inverse_depth, near.nearest, near.farthest
    off, shared = _difference(places, expected, *depths, SIGMAS * sigma, margin_m)
    return float(off / MEDIAN_OF_SIGMA), shared


def _late_blocks(view: PosedView, other: PosedView) -> int:
    """How many blocks late depth may put a surface of one view off that of another.

    None where the cameras turn alike: both show it in one place, however late.
    """
    R_other_view = other.T_camera_track[:3, :3] @ view.T_track_camera[:3, :3]
    turn_rad_s = other.frame.twist[:3] - R_other_view @ view.frame.twist[:3]
    return int(MAX_DELAY_S * np.linalg.norm(turn_rad_s) * view.frame.intrinsics.fx)


def places_in(other: PosedView, view: PosedView, step: int = 1) -> tuple[NDArray[np.int32], Floats]:
    """Of each block (h, w) of a view the one of another where it falls, by number, -1 where none.

    And the inverse depth that it has there. Both views have one camera.
    """
    return _block_places(view.frame.inverse_depth, projection(other, view), step)


def projection(other: PosedView, view: PosedView) -> Projection:
    """What takes (u, v, 1, inverse depth) of a view's block to that of another, times z: (3, 4)."""
    return tuple((other.from_track @ view.to_track).ravel().tolist())


@compiled
def _block_places(
    inverse_depth: Floats, to_other: Projection, step: int
) -> tuple[NDArray[np.int32], Floats]:
    """The loop of `places_in`."""
    height, width = inverse_depth.shape
    places = np.full((height, width), -1, np.int32)
    expected = np.zeros((height, width), np.float32)
    for v in range(0, height, step):
        for u in range(0, width, step):
            w = inverse_depth[v, u]
            if w > 0:
                places[v, u], expected[v, u] = place_of(v, u, w, to_other, height, width)
    return places, expected


@compiled
def place_of(
    v: int, u: int, w: float, to_other: Projection, height: int, width: int
) -> tuple[int, float]:
    """The block of another view where one with inverse depth w falls, or -1, and w there."""
    p = to_other
    z = p[8] * u + p[9] * v + p[10] + p[11] * w  # times w, as all three
    if z <= MIN_Z_M * w:
        return -1, 0.0
    column = (p[0] * u + p[1] * v + p[2] + p[3] * w) / z
    row = (p[4] * u + p[5] * v + p[6] + p[7] * w) / z
    if not (-0.5 <= column < width - 0.5 and -0.5 <= row < height - 0.5):
        return -1, 0.0
    return int(row + 0.5) * width + int(column + 0.5), w / z


@compiled
def _difference(
    places: NDArray[np.int32],
    expected: Floats,
    inverse_depth: Floats,
    nearest: Floats,
    farthest: Floats,
    noise: float,
    margin_m: float,
) -> tuple[float, int]:
    """Median absolute difference of inverse depth on smooth surfaces that both views see.

    Infinite where they share too few. And of how many blocks the other view is smooth.
    """
    height, width = places.shape
    depth_of, nearest_of, farthest_of = inverse_depth.ravel(), nearest.ravel(), farthest.ravel()
    off_by = np.empty((height // STRIDE + 1) * (width // STRIDE + 1), np.float32)
    shared, found = 0, 0
    for v in range(0, height, STRIDE):
        for u in range(0, width, STRIDE):
            place = places[v, u]
            if place < 0 or depth_of[place] == 0:
                continue
            tolerance = noise + margin_m * expected[v, u] * depth_of[place]
            off = abs(expected[v, u] - depth_of[place])
            if nearest_of[place] - farthest_of[place] >= tolerance:
                continue
            shared += 1
            if off < tolerance:
                off_by[found] = off
                found += 1
    return (float(np.median(off_by[:found])) if found >= MIN_FITTED else np.inf), shared


@compiled
def _add_votes(
    votes: Floats,
    weight: float,
    places: NDArray[np.int32],
    expected: Floats,
    nearest: Floats,
    farthest: Floats,
    clear: Blocks,
    noise: float,
    margin_m: float,
    step: int,
) -> None:
    """Add one view's votes, in place."""
    height, width = places.shape
    nearest_of, farthest_of, clear_at = nearest.ravel(), farthest.ravel(), clear.ravel()
    for v in range(0, height, step):
        for u in range(0, width, step):
            place = places[v, u]
            if place < 0 or nearest_of[place] == 0:
                continue
            tolerance = noise + margin_m * expected[v, u] * nearest_of[place]
            if sees_through(expected[v, u], nearest_of[place], noise, margin_m):
                votes[FREE, v, u] += weight * clear_at[place]
            elif expected[v, u] > farthest_of[place] - tolerance:
                votes[SAME, v, u] += 1


@compiled
def sees_through(expected: float, nearest: float, noise: float, margin_m: float) -> bool:
    """Whether all about a place, at inverse depths up to ``nearest``, lies beyond a surface."""
    return bool(expected - nearest > noise + margin_m * expected * nearest)


@compiled
def is_in_place(expected: float, seen: float, noise: float, margin_m: float) -> bool:
    """Whether what is seen at a place is the surface expected there; 0: nothing is seen."""
    return bool(seen > 0 and abs(expected - seen) < noise + margin_m * expected * seen)
