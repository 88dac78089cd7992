"""Odometry and closures that may both be wrong, made one pose graph: claim 3, S7."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from vnav.config import OptimiseConfig
from vnav.core import se3
from vnav.core.frame import Edge
from vnav.core.mapping import Odometry
from vnav.optimisation import pose_graph
from vnav.optimisation.contradictions import contradictions
from vnav.optimisation.mending import Mend, Mended, mend
from vnav.optimisation.pose_graph import PoseGraph
from vnav.optimisation.second_look import Correction, SecondLook
from vnav.optimisation.segments import align_segments


@dataclass(frozen=True)
class RobustGraph:
    """Odometry as ``mends`` left it, the pose graph over it, and the part (N,) of each frame."""

    odometry: Odometry
    mends: tuple[Mend, ...]
    graph: PoseGraph
    part: NDArray[np.int32]


def robust_pose_graph(
    odometry: Odometry, closures: Sequence[Edge], config: OptimiseConfig, look: SecondLook | None
) -> RobustGraph:
    """Odometry mended where it contradicts itself or many closures, and the closures that agree.

    Where closures contradict a stretch, its keyframes are looked at again; without that, odometry
    stays as it is there. Closures that are kept lie within one part.
    """
    corrections: list[Correction] = []
    while True:
        mended = mend(odometry, corrections, closures, config, look)
        robust = _optimised(mended, closures, config)
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


def _optimised(mended: Mended, closures: Sequence[Edge], config: OptimiseConfig) -> RobustGraph:
    odometry = mended.odometry
    segments = odometry.T_segment_camera, odometry.segment, odometry.frames.capture
    initial, _ = align_segments(*segments, closures)
    graph = pose_graph.optimise(initial, odometry.edges, closures, config.max_closure_sigmas)
    _, part = align_segments(*segments, list(compress(closures, graph.kept)))
    inside = np.array([part[e.i] == part[e.j] for e in closures], bool)
    graph = dataclasses.replace(graph, kept=graph.kept & inside)
    return RobustGraph(odometry, mended.mends, graph, part)
