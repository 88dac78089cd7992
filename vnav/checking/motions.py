"""A map's motions between two keyframes, held against their pixels.

Where places look the same, many loops are false, and a good map turns them down: pixels then see no
better motion in the loop than in the map. A map that is wrong turns down loops that are right.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import Edge
from vnav.core.graph import shortest_paths
from vnav.core.reduced_frame import Seen
from vnav.registration.judge import CLEAR, judge


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
    posed = np.isfinite(T_world_camera[:, 0, 0])
    steps = zip(rows[:-1].tolist(), rows[1:].tolist(), strict=True)
    found = []
    for step in shortest_paths(motions, [(i, j) for i, j in steps if posed[i] and posed[j]]):
        i, j = step.i, step.j
        T_i_j = se3.inverse(T_world_camera[i]) @ T_world_camera[j]
        if judge(seen(i), seen(j), [T_i_j], config).log_odds[0, -1] < CLEAR:
            found.append((i, j))
    return found


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
