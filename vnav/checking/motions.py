"""A map's motions between two keyframes, held against their pixels.

Where places look the same, many loops are false, and a good map turns them down: pixels then see no
better motion in the loop than in the map. A map that is wrong turns down loops that are right.
"""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import Edge
from vnav.core.reduced_frame import Seen
from vnav.registration.judge import CLEAR, judge


def unborne_steps(
    rows: NDArray[np.intp],
    motions: Iterable[Edge],
    T_world_camera: Array,
    seen: Seen,
    config: RegistrationConfig,
) -> list[tuple[int, int]]:
    """Keyframes that follow each other by a motion that pixels do not clearly bear out, by rows.

    ``rows`` (K,) of the keyframes, ``T_world_camera`` (N, 4, 4) of all frames. Keyframes do not
    follow each other where no ``motions`` of odometry lead on, as where a recording was cut and an
    earlier place found again; nor without a pose.
    """
    posed = np.isfinite(T_world_camera[:, 0, 0])
    sources: dict[int, list[int]] = {}
    for e in motions:
        sources.setdefault(e.j, []).append(e.i)
    found = []
    for i, j in zip(rows[:-1].tolist(), rows[1:].tolist(), strict=True):
        if not (posed[i] and posed[j] and _lead_on(sources, i, j)):
            continue
        T_i_j = se3.inverse(T_world_camera[i]) @ T_world_camera[j]
        if judge(seen(i), seen(j), [T_i_j], config).log_odds[0, -1] < CLEAR:
            found.append((i, j))
    return found


def _lead_on(sources: Mapping[int, Sequence[int]], i: int, j: int) -> bool:
    """Whether motions lead from a frame to a later one over none but those between them.

    ``sources``: by frame, those that motions to it are from.
    """
    reached = {i}
    for row in range(i + 1, j + 1):
        if not reached.isdisjoint(sources.get(row, ())):
            reached.add(row)
    return j in reached


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
