"""Stretches of odometry that closures contradict: more agree on another motion than on this one."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import Edge
from vnav.core.graph import ends_of, weakest
from vnav.core.mapping import Odometry
from vnav.optimisation.segments import same_pose

MIN_AGREEING = 3  # closures; fewer agree by chance
NEAR = 5  # keyframes that a closure spans whose path of odometry is too short to drift


@dataclass(frozen=True)
class Contradiction:
    """Neighbouring keyframes, by row, and the motion between them that ``closures`` imply."""

    i: int
    j: int
    T_i_j: Array
    closures: int

    def weakest(self, edges: Iterable[Edge]) -> tuple[int, float]:
        """Of the frames after i to j, by `core.graph.weakest`."""
        return weakest(edges, self.i, self.j)


def contradictions(
    odometry: Odometry, T_world_camera: Array, closures: Sequence[Edge], kept: NDArray[np.bool_]
) -> list[Contradiction]:
    """Stretches between neighbouring keyframes that sets of rejected closures contradict.

    A set agrees on the motion across the stretch, by the optimised poses (N, 4, 4) on either side
    of it, and is larger than the number of closures across it that were ``kept`` (C,): of those
    that span few keyframes, or of all.
    """
    rows, segment = odometry.keyframe_rows, odometry.segment
    ends = ends_of(closures)
    is_near = np.diff(np.searchsorted(rows, ends), axis=1)[:, 0] <= NEAR
    joined = (segment[ends] == segment[ends[:, :1]]).all(1)
    found = []
    for i, j in zip(rows[:-1].tolist(), rows[1:].tolist(), strict=True):
        across = joined & (ends[:, 0] <= i) & (ends[:, 1] >= j)
        for counted in (across & is_near, across):
            against = [closures[n] for n in np.flatnonzero(counted & ~kept).tolist()]
            fewest = max(MIN_AGREEING, int((counted & kept).sum()) + 1)
            most = _largest_set(against, i, j, T_world_camera) if len(against) >= fewest else None
            if most is not None and most.closures >= fewest:
                found.append(most)
                break
    return found


def _largest_set(closures: Sequence[Edge], i: int, j: int, T_world_camera: Array) -> Contradiction:
    """The closures that agree most on the motion from frame i to j."""
    a, b = ends_of(closures).T
    T_i_a = se3.inverse(T_world_camera[i]) @ T_world_camera[a]
    T_b_j = se3.inverse(T_world_camera[b]) @ T_world_camera[j]
    T_i_j = T_i_a @ np.stack([e.T_i_j for e in closures]) @ T_b_j
    agreeing = same_pose(se3.inverse(T_i_j)[:, None] @ T_i_j).sum(1)
    best = int(agreeing.argmax())
    return Contradiction(i, j, T_i_j[best], int(agreeing[best]))
