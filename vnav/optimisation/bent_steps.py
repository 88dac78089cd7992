"""Closures that bend steps of odometry which pixels bear out: these are false.

What repeats itself has closures that agree with each other, and steps that are loosely held by
their own noise give way to them.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import Edge
from vnav.core.graph import ends_of, off_edges
from vnav.core.mapping import LOST, Odometry
from vnav.optimisation.second_look import SecondLook
from vnav.optimisation.segments import same_pose
from vnav.registration.judge import CLEAR


def bending(
    odometry: Odometry,
    T_world_camera: Array,
    closures: Sequence[Edge],
    kept: NDArray[np.bool_],
    look: SecondLook,
) -> NDArray[np.bool_]:
    """Which of the ``kept`` closures (C,) bend a step, by the poses (N, 4, 4) that they lead to.

    The step is from a keyframe to the next, far from where odometry has it, and only odometry's
    motion is clearly likelier than none. Those that lead across it bend it, unless they agree with
    odometry.
    """
    found = np.zeros(len(closures), bool)
    i, j = ends_of(closures).T
    against = kept & ~same_pose(off_edges(odometry.T_segment_camera, closures))
    for first, last in _bent(odometry, T_world_camera, look) if against.any() else ():
        found |= against & (np.minimum(i, j) <= first) & (np.maximum(i, j) >= last)
    return found


def _bent(odometry: Odometry, T_world_camera: Array, look: SecondLook) -> list[tuple[int, int]]:
    """Steps, by rows, whose motion pixels bear out by odometry and not by poses (N, 4, 4)."""
    rows, segment = odometry.keyframe_rows, odometry.segment
    i, j = rows[:-1], rows[1:]
    within = (segment[i] == segment[j]) & (segment[i] != LOST)
    motions = [se3.inverse(T[i]) @ T[j] for T in (odometry.T_segment_camera, T_world_camera)]
    asked = np.flatnonzero(within & ~same_pose(se3.inverse(motions[0]) @ motions[1]))
    steps = []
    for n in asked.tolist():
        log_odds = look.log_odds(int(i[n]), int(j[n]), [motion[n] for motion in motions])
        if log_odds[0, -1] > CLEAR > log_odds[1, -1]:
            steps.append((int(i[n]), int(j[n])))
    return steps
