"""Odometry and closures that may both be wrong, made one pose graph: claim 3, S7."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from vnav.config import OptimiseConfig
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import Edge
from vnav.core.graph import ends_of
from vnav.core.jumps import between_jumps
from vnav.core.mapping import Odometry
from vnav.optimisation import pose_graph
from vnav.optimisation.contradictions import contradictions
from vnav.optimisation.mending import TOO_FAST, Mend, Mended, mend, too_fast, without
from vnav.optimisation.pose_graph import PoseGraph
from vnav.optimisation.second_look import Correction, SecondLook
from vnav.optimisation.segments import Inside, align_segments, same_pose


@dataclass(frozen=True)
class RobustGraph:
    """Odometry as ``mends`` left it, the pose graph over it, and the part (N,) of each frame.

    The graph's ``closure_sigmas`` are of those closures alone that it was asked about.
    """

    odometry: Odometry
    mends: tuple[Mend, ...]
    graph: PoseGraph
    part: NDArray[np.int32]


def robust_pose_graph(
    odometry: Odometry, closures: Sequence[Edge], config: OptimiseConfig, look: SecondLook | None
) -> RobustGraph:
    """Odometry mended where it contradicts itself or many closures, and the closures that agree.

    Where closures contradict a stretch, its keyframes are looked at again; without that, odometry
    stays as it is there. Frames between jumps are lost: no camera has moved like that. Closures
    that are kept lie within one part.
    """
    robust = _held_against(odometry, closures, config, look)
    rows = between_jumps(odometry.frames, robust.graph.T_world_camera, robust.part)
    if not len(rows):
        return robust
    asked = np.flatnonzero(~np.isin(ends_of(closures), rows).any(1))
    fewer = without(odometry, rows, TOO_FAST), [closures[n] for n in asked.tolist()]
    steady = robust_pose_graph(*fewer, config, look)
    kept = np.zeros(len(closures), np.bool_)
    kept[asked] = steady.graph.kept
    graph = dataclasses.replace(steady.graph, kept=kept)
    return dataclasses.replace(steady, graph=graph, mends=(*too_fast(rows), *steady.mends))


def _held_against(
    odometry: Odometry, closures: Sequence[Edge], config: OptimiseConfig, look: SecondLook | None
) -> RobustGraph:
    """Odometry as its own edges, closures and keyframes correct it, and the closures that agree."""
    corrections: list[Correction] = []
    while True:
        mended = mend(odometry, corrections, closures, config, look)
        robust = _optimised(mended, closures, config, look)
        new = [] if look is None else _corrections(robust, closures, look, corrections)
        if not new:
            return robust
        corrections += new


def _corrections(
    robust: RobustGraph, closures: Sequence[Edge], look: SecondLook, before: Sequence[Correction]
) -> list[Correction]:
    """What replaces further stretches that closures contradict, where the pixels do so, too."""
    odometry, graph = robust.odometry, robust.graph
    found = contradictions(odometry, graph.T_world_camera, closures, graph.kept)
    corrected = {(c.stretch.i, c.stretch.j) for c in before}
    T = odometry.T_segment_camera
    looked_at = (
        look.correct(c, se3.inverse(T[c.i]) @ T[c.j]) for c in found if (c.i, c.j) not in corrected
    )
    return [correction for correction in looked_at if correction is not None]


def _optimised(
    mended: Mended, closures: Sequence[Edge], config: OptimiseConfig, look: SecondLook | None
) -> RobustGraph:
    """The pose graph over segments that closures join and images bear out.

    Closures that would have joined them otherwise are not asked: they may be the most.
    """
    odometry = mended.odometry
    segments = odometry.T_segment_camera, odometry.segment, odometry.frames.capture
    joins = _Joins(odometry.edges, closures, config.max_closure_sigmas, look)
    initial, part = align_segments(*segments, closures, joins.are_borne_out)
    asked = _within(part, closures) & ~joins.refused
    graph = pose_graph.optimise(
        initial, odometry.edges, list(compress(closures, asked)), config.max_closure_sigmas
    )
    asked[asked] = graph.kept
    _, part = align_segments(*segments, list(compress(closures, asked)))
    graph = dataclasses.replace(graph, kept=asked & _within(part, closures))
    return RobustGraph(odometry, mended.mends, graph, part)


class _Joins:
    """Alignments of segments, tested by what their keyframes see; ``refused``: closures (C,)."""

    def __init__(
        self,
        edges: Sequence[Edge],
        closures: Sequence[Edge],
        max_sigmas: float,
        look: SecondLook | None,
    ) -> None:
        self._edges, self._closures = edges, closures
        self._max_sigmas, self._look = max_sigmas, look
        self._ends = ends_of(closures)
        self.refused = np.zeros(len(closures), bool)

    def are_borne_out(self, poses: Array, a: Inside, b: Inside) -> bool:
        """Whether two sets of frames (N,) agree on what both see, where poses align them.

        The pose graph takes drift away first, by the closures that agree with the poses. What was
        refused stays so.
        """
        if self._look is None:
            return True
        across = self._agreeing(poses, a, b)
        if self.refused[across].all():
            return False
        poses = np.where((a | b)[:, None, None], poses, np.nan)
        inside = [e for e in self._edges if (a | b)[e.i] and (a | b)[e.j]]
        within = (a[self._ends].all(1) | b[self._ends].all(1)) & ~self.refused
        used = list(compress(self._closures, across | within))
        graph = pose_graph.optimise(poses, inside, used, self._max_sigmas)
        right = self._look.is_borne_out(graph.T_world_camera, a, b)
        self.refused |= across & (not right)
        return right

    def _agreeing(self, poses: Array, a: Inside, b: Inside) -> Inside:
        """Which closures (C,) between the two agree with poses."""
        i, j = self._ends.T
        T_i_j = np.stack([e.T_i_j for e in self._closures])
        across = (a[i] & b[j]) | (b[i] & a[j])
        return np.asarray(across & same_pose(se3.inverse(poses[i] @ T_i_j) @ poses[j]))


def _within(part: NDArray[np.int32], closures: Sequence[Edge]) -> NDArray[np.bool_]:
    """Which closures (C,) lead from a part to the same."""
    i, j = ends_of(closures).T
    return np.asarray(part[i] == part[j])
