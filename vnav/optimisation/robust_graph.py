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
from vnav.optimisation.bent_steps import bending
from vnav.optimisation.contradictions import contradictions
from vnav.optimisation.interruptions import claims
from vnav.optimisation.joins import Joins
from vnav.optimisation.mending import (
    INTERRUPTED,
    TOO_FAST,
    Mend,
    Mended,
    mend,
    mends_of,
    too_fast,
    with_edges,
    without,
)
from vnav.optimisation.pose_graph import PoseGraph
from vnav.optimisation.second_look import Correction, SecondLook
from vnav.optimisation.segments import Choose, align_segments, first


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
    stays as it is there. Closures that bend what pixels bear out are not asked. Frames between
    jumps are lost: no camera has moved like that. Closures that are kept lie within one part.
    """
    robust = _held_against(odometry, closures, config, look)
    T, kept = robust.graph.T_world_camera, robust.graph.kept
    if look is not None:
        bent = bending(robust.odometry, T, closures, kept, look)
        if bent.any():
            return _of_some(odometry, closures, np.flatnonzero(~bent), config, look)
    rows = between_jumps(odometry.frames, T, robust.part)
    if not len(rows):
        return robust
    asked = np.flatnonzero(~np.isin(ends_of(closures), rows).any(1))
    steady = _of_some(without(odometry, rows, TOO_FAST), closures, asked, config, look)
    return dataclasses.replace(steady, mends=(*too_fast(rows), *steady.mends))


def _of_some(
    odometry: Odometry,
    closures: Sequence[Edge],
    asked: NDArray[np.intp],
    config: OptimiseConfig,
    look: SecondLook | None,
) -> RobustGraph:
    """`robust_pose_graph` by some of the closures (C,), by number; the others are not kept."""
    robust = robust_pose_graph(odometry, [closures[n] for n in asked.tolist()], config, look)
    kept = np.zeros(len(closures), np.bool_)
    kept[asked] = robust.graph.kept
    return dataclasses.replace(robust, graph=dataclasses.replace(robust.graph, kept=kept))


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

    Closures that would have joined them otherwise are not asked: they may be the most. What
    odometry claims across an interruption is held against them.
    """
    odometry = mended.odometry
    claimed = claims(odometry) if look else np.zeros(len(odometry.edges), bool)
    followed = _without(odometry, claimed)
    candidates = [*closures, *compress(odometry.edges, claimed)]
    joins = Joins(followed, candidates, config.max_closure_sigmas, look)
    initial, part = _aligned(followed, candidates, joins.right)
    asked = _within(part, candidates) & ~joins.refused
    graph = pose_graph.optimise(
        initial, followed.edges, list(compress(candidates, asked)), config.max_closure_sigmas
    )
    asked[asked] = graph.kept
    kept, borne_out = np.split(asked, [len(closures)])
    claimed[claimed] = ~borne_out
    held = _without(odometry, claimed)
    _, part = _aligned(held, list(compress(closures, kept)))
    graph = dataclasses.replace(graph, kept=kept & _within(part, closures))
    joined = dataclasses.replace(held, segment=part)
    mends = *mended.mends, *mends_of(odometry, joined, INTERRUPTED), *joins.unsure
    return RobustGraph(held, mends, graph, part)


def _without(odometry: Odometry, claimed: NDArray[np.bool_]) -> Odometry:
    """Odometry without some of its edges (E,)."""
    if not claimed.any():
        return odometry
    return with_edges(odometry, list(compress(odometry.edges, ~claimed)), INTERRUPTED)


def _aligned(
    odometry: Odometry, closures: Sequence[Edge], right: Choose = first
) -> tuple[Array, NDArray[np.int32]]:
    """Poses (N, 4, 4) of odometry's segments as closures align them, and connected parts (N,)."""
    segments = odometry.T_segment_camera, odometry.segment, odometry.frames.capture
    return align_segments(*segments, closures, right)


def _within(part: NDArray[np.int32], closures: Sequence[Edge]) -> NDArray[np.bool_]:
    """Which closures (C,) lead from a part to the same."""
    i, j = ends_of(closures).T
    return np.asarray(part[i] == part[j])
