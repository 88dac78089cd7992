"""Which keyframes see the same place again: claim 3, S6 and the edges of S7."""

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from vnav.config import Config, LoopsConfig
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.frame import Edge
from vnav.core.mapping import LoopVerdict, Odometry, counted
from vnav.core.progress import Progress, silent
from vnav.core.report import Report
from vnav.core.tree import VocabularyTree
from vnav.core.view_overlap import view_overlap
from vnav.io.store.artifacts import (
    load_keyframe,
    load_odometry,
    map_cameras,
    save_loops,
)
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.stage_reports import clock, finished, reused, settings_of
from vnav.io.store.tree_file import load_tree
from vnav.loop_closing.loop_candidates import LoopCandidate, by_appearance, by_proximity
from vnav.loop_closing.loop_verification import NEIGHBOURS, Closures, LoopVerifier
from vnav.optimisation.robust_graph import robust_pose_graph
from vnav.optimisation.second_look import SecondLook
from vnav.threads import one_blas_thread

STAGE = "loops"


@one_blas_thread
def run(folder: MapFolder, config: Config, *, progress: Progress = silent) -> Report:
    """Find, verify and record loops between keyframes."""
    started = clock()
    settings = settings_of(config, "registration", STAGE, "optimise")
    inputs = folder.inputs_of("odometry", "vocabulary")
    if folder.is_current(STAGE, settings, inputs):
        return reused(folder, STAGE)
    odometry, tree, cameras = load_odometry(folder), load_tree(folder), map_cameras(folder)

    views = partial(load_keyframe, folder, frames=odometry.frames)
    look = SecondLook(odometry, cameras, views, config)
    found = close_loops(odometry, tree, cameras, config, progress, look)

    with folder.writing(STAGE, settings, inputs) as draft:
        save_loops(draft, found.verdicts, found.edges, found.matches)

    return finished(folder, _report(found.verdicts), started)


def close_loops(
    odometry: Odometry,
    tree: VocabularyTree,
    cameras: Sequence[Intrinsics],
    config: Config,
    progress: Progress = silent,
    look: SecondLook | None = None,
) -> Closures:
    """Loops by appearance, then by nearness of the poses that those give, until nothing is new."""
    log_odds = None if look is None else look.log_odds
    verifier = LoopVerifier(odometry, cameras, config, progress, log_odds)
    found = Closures()
    verifier.verify(by_appearance(odometry, tree, config.loops), found)
    for _ in range(config.loops.proximity_rounds):
        T_world_camera, part = _poses(odometry, found.edges, config, look)
        overlap = view_overlap(odometry, T_world_camera, part, cameras)
        candidates = by_proximity(overlap, config.loops, found.tried)
        verifier.verify(candidates, found, T_world_camera)
        across = _across_cuts(odometry, part, cameras, config.loops, found.tried)
        verifier.verify(across, found, odometry.T_segment_camera)
        if not (candidates or across):
            break
    return found


def _across_cuts(
    odometry: Odometry,
    part: NDArray[np.int32],
    cameras: Sequence[Intrinsics],
    config: LoopsConfig,
    tried: set[tuple[int, int]],
) -> list[LoopCandidate]:
    """Neighbours that odometry joined, and a contradiction of its own cut apart.

    Late depth makes edges contradict each other, too, and then neighbours hold the map together.
    """
    rows = odometry.keyframe_rows
    number, segment, part = np.arange(len(rows)), odometry.segment[rows], part[rows]
    is_near = np.abs(number[:, None] - number) <= NEIGHBOURS
    is_cut = is_near & (segment[:, None] == segment) & (part[:, None] != part)
    if not is_cut.any():
        return []
    overlap = view_overlap(odometry, odometry.T_segment_camera, odometry.segment, cameras)
    return by_proximity(np.where(is_cut, overlap, np.float32(0)), config, tried)


def _poses(
    odometry: Odometry, closures: Sequence[Edge], config: Config, look: SecondLook | None
) -> tuple[Array, NDArray[np.int32]]:
    """Poses (N, 4, 4) and parts (N,) as the closures so far give them, or as they were given."""
    if odometry.given:
        return odometry.T_segment_camera, odometry.segment
    robust = robust_pose_graph(odometry, closures, config.optimise, look)
    return robust.graph.T_world_camera, robust.part


def _report(verdicts: Sequence[LoopVerdict]) -> Report:
    values = counted(verdicts)
    line = (
        f"{values['accepted']} of {values['tried']} loop candidates accepted, and"
        f" {values['neighbours_accepted']} of {values['neighbours_tried']} pairs of neighbours"
    )
    return Report(STAGE, values, (line,))
