"""Keyframes that see one place at different times: whether they agree on it.

A map that is bent puts surfaces where other keyframes see free space, or beside themselves. How far
two keyframes may differ, their sensor tells itself: by keyframes that follow each other.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.arrays import Array, Floats
from vnav.core.reduced_frame import BLOCK_PX, ReducedFrame, Seen
from vnav.registration.dense import fitted_near
from vnav.registration.judge import CLEAR, are_same, judge
from vnav.registration.pixel_evidence import carried

STRIDE_PX = 2  # between the pixels that are compared
MIN_SHARED = 0.1  # share of the pixels that must fall on a surface of the other
SEEN_THROUGH_SIGMAS = 6.0  # that a point lies before a surface that sees through it, in a map
GREY_SIGMA = 1.0  # brightness is not compared
USUAL = 0.9  # quantile of neighbours that says what is usual
MEDIAN_SIGMAS = 0.17  # at most, of the median distance by noise alone: blocks are means of 16
UNUSUAL_TIMES = 2.0  # off by so many times what is usual
UNUSUAL_SHARE = 0.1  # of points seen through, beyond what is usual
BESIDE_M = 0.2 * np.eye(3)  # to either side of a pose, and far enough to be another


@dataclass(frozen=True)
class Agreement:
    """How the surfaces of two keyframes stand to each other at their poses in the map.

    ``i``, ``j``: their rows; ``off_sigmas``: median distance between them in standard deviations of
    measured depth; ``seen_through``: share of points that the other keyframe sees through.
    """

    i: int
    j: int
    off_sigmas: float
    seen_through: float


def agreement(
    rows: tuple[int, int],
    frames: tuple[ReducedFrame, ReducedFrame],
    T_i_j: Array,
    config: RegistrationConfig,
    through_sigmas: float = SEEN_THROUGH_SIGMAS,
) -> Agreement | None:
    """How two keyframes agree where ``T_i_j`` is between them; None where they share too little.

    A point so many ``through_sigmas`` before the other's surface is seen through.
    """
    i, j = frames
    ways = _nearer(i, j, se3.inverse(T_i_j), config), _nearer(j, i, T_i_j, config)
    nearer = np.concatenate(ways)
    shared = nearer[np.isfinite(nearer)]
    if len(shared) < MIN_SHARED * len(nearer):
        return None
    seen_through = float((shared > through_sigmas).mean())
    return Agreement(*rows, float(np.median(np.abs(shared))), seen_through)


def agreements(
    pairs: Iterable[tuple[int, int]],
    T_world_camera: Array,
    seen: Seen,
    config: RegistrationConfig,
    through_sigmas: float = SEEN_THROUGH_SIGMAS,
) -> list[Agreement]:
    """How pairs of keyframes, by row, agree at their poses (N, 4, 4), where they share enough."""
    found = (
        agreement(
            (i, j),
            (seen(i), seen(j)),
            se3.inverse(T_world_camera[i]) @ T_world_camera[j],
            config,
            through_sigmas,
        )
        for i, j in pairs
    )
    return [each for each in found if each is not None]


def disagreeing(
    revisits: Sequence[Agreement],
    neighbours: Sequence[Agreement],
    is_borne_out: Callable[[Agreement], bool],
) -> list[Agreement]:
    """Those revisits that agree less than neighbours usually do; none without neighbours.

    Somebody who stood there for one of the two, or what came or left meanwhile, is seen through as
    a surface is that the map displaces. Images that bear the poses out tell the one from the other.
    """
    if not neighbours:
        return []
    off = UNUSUAL_TIMES * max(_usual([n.off_sigmas for n in neighbours]), MEDIAN_SIGMAS)
    through = _most_through(neighbours)

    def disagrees(each: Agreement) -> bool:
        return each.off_sigmas > off or (each.seen_through > through and not is_borne_out(each))

    return [each for each in revisits if disagrees(each)]


def borne_out(a: ReducedFrame, b: ReducedFrame, T_a_b: Array, config: RegistrationConfig) -> bool:
    """Whether all pixels clearly prefer a motion to those beside it, and to chance.

    And do not clearly prefer the one that fits best near it. By far off the truth, surfaces that
    are alike agree there and beside it.
    """
    best = fitted_near(a, b, config, T_a_b)
    nearer = [] if are_same(a, T_a_b, best, config) else [best]
    beside = T_a_b @ se3.make(np.eye(3), np.concatenate([BESIDE_M, -BESIDE_M]))
    log_odds = judge(a, b, [T_a_b, *nearer, *beside], config).log_odds[0, 1:]
    than_best, than_others = np.split(log_odds, [len(nearer)])
    return bool((than_best > -CLEAR).all() and (than_others > CLEAR).all())


def borne_out_by(
    T_world_camera: Array, seen: Seen, config: RegistrationConfig
) -> Callable[[Agreement], bool]:
    """Whether images bear out how two keyframes stand to each other at their poses (N, 4, 4)."""

    def is_borne_out(each: Agreement) -> bool:
        T_i_j = se3.inverse(T_world_camera[each.i]) @ T_world_camera[each.j]
        return borne_out(seen(each.i), seen(each.j), T_i_j, config)

    return is_borne_out


def seeing_through(
    revisits: Sequence[Agreement], neighbours: Sequence[Agreement]
) -> list[Agreement]:
    """Those that see through what the other sees, unlike neighbours; none without neighbours.

    Drift puts surfaces beside each other: where it is left, ask from how far on they are so.
    """
    if not neighbours:
        return []
    most = _most_through(neighbours)
    return [r for r in revisits if r.seen_through > most]


def _most_through(neighbours: Sequence[Agreement]) -> float:
    return _usual([n.seen_through for n in neighbours]) + UNUSUAL_SHARE


def _usual(values: Sequence[float]) -> float:
    return float(np.quantile(values, USUAL))


def _nearer(a: ReducedFrame, b: ReducedFrame, T_b_a: Array, config: RegistrationConfig) -> Array:
    """How much nearer (N,) points of a are than b's surface, in sigmas; NaN where hidden."""
    cameras = np.zeros((2, 10))  # at rest: their delays are known by now
    cameras[:, :4] = a.intrinsics.pinhole, b.intrinsics.pinhole
    sigmas = np.array(
        [config.pixel_sigma_px / BLOCK_PX, config.depth_sigma_per_m2, GREY_SIGMA, 0, 0]
    )
    pixels, images = _grid(a), (_image(a), _image(b))
    late = np.full((len(pixels), 3), np.nan)
    met = carried(np.ascontiguousarray(T_b_a), *images, cameras, pixels, late, sigmas)
    return np.asarray(met[:, 0] / met[:, 2])


def _image(frame: ReducedFrame) -> Floats:
    return np.stack([frame.inverse_depth, frame.grey], -1)


def _grid(frame: ReducedFrame) -> NDArray[np.int64]:
    rows, columns = np.indices(frame.grey.shape)[:, ::STRIDE_PX, ::STRIDE_PX]
    return np.stack([columns.ravel(), rows.ravel()], -1).astype(np.int64)
