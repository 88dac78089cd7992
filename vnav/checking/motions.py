"""A map's motions between two keyframes, held against their pixels.

Where places look the same, many loops are false, and a good map turns them down: pixels then see no
better motion in the loop than in the map. A map that is wrong turns down loops that are right.
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import Edge
from vnav.core.graph import shortest_paths
from vnav.core.reduced_frame import Seen
from vnav.registration.judge import CLEAR, judge, refuted

MOST = 0.5  # share of a view that moves: from there on, what stands still is the lesser part
SEEN_MOVING = 0.2  # of what moves, the share that the images of two keyframes must bear out
LEAST_STANDING = 3  # steps, one after the other
MaskedStep = tuple[int, int, Array, NDArray[np.bool_]]  # rows, motion (4, 4), what moves


def unborne_steps(
    rows: NDArray[np.intp],
    motions: Sequence[Edge],
    T_world_camera: Array,
    seen: Seen,
    config: RegistrationConfig,
) -> list[tuple[int, int]]:
    """Keyframes that follow each other by a motion that pixels do not clearly bear out, by rows.

    ``rows`` (K,) of the keyframes, ``T_world_camera`` (N, 4, 4) of all frames. Keyframes do not
    follow each other where no ``motions`` of odometry lead on, as where a recording was cut and an
    earlier place found again; nor without a pose.
    """
    return [
        (i, j)
        for i, j, T_i_j in _steps(rows, motions, T_world_camera)
        if judge(seen(i), seen(j), [T_i_j], config).log_odds[0, -1] < CLEAR
    ]


def contradicting_loops(
    rejected: Sequence[Edge], T_world_camera: Array, seen: Seen, config: RegistrationConfig
) -> list[Edge]:
    """Those rejected loops whose motion pixels clearly prefer to that between the map's poses.

    ``T_world_camera`` (N, 4, 4) of all frames; a loop to one without a pose tells nothing.
    """
    posed = np.isfinite(T_world_camera[:, 0, 0])
    found = []
    for loop in rejected:
        if not (posed[loop.i] and posed[loop.j]):
            continue
        T_i_j = se3.inverse(T_world_camera[loop.i]) @ T_world_camera[loop.j]
        evidence = judge(seen(loop.i), seen(loop.j), [loop.T_i_j, T_i_j], config)
        if evidence.log_odds[0, 1] > CLEAR:
            found.append(loop)
    return found


def standing_steps(
    rows: NDArray[np.intp],
    motions: Sequence[Edge],
    T_world_camera: Array,
    whole: Seen,
    moving: Callable[[int], NDArray[np.bool_]],
    config: RegistrationConfig,
) -> list[tuple[int, int]]:
    """Keyframes that follow each other, most of which is taken for moving, but stands, by rows.

    A track that is wrong contradicts what it saw a while ago, and takes all of that for moving.
    From one keyframe to the next it stands still all the same, where things repeat themselves. That
    goes on step after step; alone, a mask may be too large. Arguments as for `unborne_steps`;
    ``whole``: keyframes with what moves; ``moving``: which blocks (h, w) of one do.
    """
    steps = ((i, j, T, moving(j)) for i, j, T in _steps(rows, motions, T_world_camera))
    found = _in_runs([step for step in steps if step[-1].mean() > MOST])
    moved = sum(int(moves.sum()) for *_, moves in found)
    borne_out = sum(
        int((moves & refuted(whole(i), whole(j), T, config)).sum()) for i, j, T, moves in found
    )
    return [] if borne_out >= SEEN_MOVING * moved else [(i, j) for i, j, *_ in found]


def _in_runs(steps: Sequence[MaskedStep]) -> list[MaskedStep]:
    """Those of `LEAST_STANDING` and more that follow each other."""
    starts = [k for k, step in enumerate(steps) if k == 0 or steps[k - 1][1] != step[0]]
    runs = (steps[begin:end] for begin, end in pairwise([*starts, len(steps)]))
    return [step for run in runs if len(run) >= LEAST_STANDING for step in run]


def _steps(
    rows: NDArray[np.intp], motions: Sequence[Edge], T_world_camera: Array
) -> Iterator[tuple[int, int, Array]]:
    """Rows of keyframes that follow each other by odometry, and the map's motion (4, 4) between."""
    posed = np.isfinite(T_world_camera[:, 0, 0])
    pairs = zip(rows[:-1].tolist(), rows[1:].tolist(), strict=True)
    for step in shortest_paths(motions, [(i, j) for i, j in pairs if posed[i] and posed[j]]):
        yield step.i, step.j, se3.inverse(T_world_camera[step.i]) @ T_world_camera[step.j]
