"""One robust pose graph over all frames, then landmarks and bundle adjustment: claim 3, S7."""

import dataclasses
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vnav.config import Config
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.mapping import CONTRADICTS, LoopVerdict, Odometry
from vnav.core.progress import Progress, silent
from vnav.core.report import Report
from vnav.core.trajectory import Trajectory
from vnav.features.description import near_depth
from vnav.io.formats.g2o import write_g2o
from vnav.io.formats.trajectories import write_tum
from vnav.io.store.artifacts import (
    load_keyframe,
    load_keyframe_depth,
    load_loop_edges,
    load_loops,
    load_odometry,
    map_cameras,
    require_features,
    save_mended_edges,
    save_optimised,
    save_verdicts,
)
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.stage_reports import clock, finished, reused, settings_of
from vnav.optimisation.pose_graph import PoseGraph
from vnav.optimisation.second_look import SecondLook
from vnav.optimisation.sensor_errors import DepthOf
from vnav.optimisation.solution import Solution, solve
from vnav.optimisation.solution_report import solution_report
from vnav.optimisation.surface import Surface, sample_surface
from vnav.optimisation.world import place_in_world
from vnav.threads import one_blas_thread

STAGE = "optimise"
KEPT_IMAGES = 150  # depth images that are read once: 184 MB of 640 x 480


@one_blas_thread
def run(folder: MapFolder, config: Config, *, progress: Progress = silent) -> Report:
    """Final poses of all frames, landmarks, and the world frame."""
    started = clock()
    settings = settings_of(config, "registration", "odometry", "loops", STAGE)
    inputs = folder.inputs_of("odometry", "loops")
    if folder.is_current(STAGE, settings, inputs):
        return reused(folder, STAGE)
    odometry, cameras = load_odometry(folder), map_cameras(folder)
    (closures, matches), verdicts = load_loop_edges(folder), load_loops(folder, "loops")
    for pair in (matches[:, :2], matches[:, 2:]):
        require_features(odometry, pair[:, 0], pair[:, 1], folder.root / "loops" / "matches.npz")

    views = partial(load_keyframe, folder, frames=odometry.frames)
    look = SecondLook(odometry, cameras, views, config)
    depth_of = _near_depth(folder, config)
    solution = solve(odometry, closures, matches, cameras, config, progress, depth_of, look)
    surface = _keyframe_surface(depth_of, solution, odometry, cameras)
    rng = np.random.default_rng([config.seed, 2])
    result = place_in_world(solution, odometry, surface, rng, config.optimise.up_in_images)

    with folder.writing(STAGE, settings, inputs) as draft:
        save_optimised(draft, result)
        save_verdicts(draft, final_verdicts(verdicts, solution.robust.graph))
        _write_trajectories(draft, odometry, result.T_world_camera)
        _write_other_parts(draft, odometry, solution)
        edges = solution.robust.odometry.edges
        save_mended_edges(draft, edges)
        g2o = [*edges, *solution.closures, *solution.surfaces]
        write_g2o(draft / "graph.g2o", result.T_world_camera, g2o)

    return finished(folder, solution_report(solution, result, odometry), started)


def final_verdicts(verdicts: Sequence[LoopVerdict], graph: PoseGraph) -> list[LoopVerdict]:
    """The verdicts, with the closures rejected that the pose graph rejected."""
    kept = iter(graph.kept)
    return [
        verdict
        if not verdict.accepted or next(kept)
        else dataclasses.replace(verdict, accepted=False, reason=CONTRADICTS)
        for verdict in verdicts
    ]


def _near_depth(folder: MapFolder, config: Config) -> DepthOf:
    """Reads a keyframe's depth as odometry used it: 0 where it is too far, too.

    The first images stay in memory: all are asked for in turn, so the last would never be there.
    """
    kept = dict[int, NDArray[np.float32]]()

    def depth_of(row: int) -> NDArray[np.float32]:
        if row in kept:
            return kept[row]
        depth_m = near_depth(load_keyframe_depth(folder, row), config)
        if len(kept) < KEPT_IMAGES:
            kept[row] = depth_m
        return depth_m

    return depth_of


def _keyframe_surface(
    depth_of: DepthOf, solution: Solution, odometry: Odometry, cameras: Sequence[Intrinsics]
) -> Surface:
    """What the adjusted keyframes saw; their depth is read one image at a time."""
    T_any_camera = solution.adjusted.T_world_camera
    posed = np.isfinite(T_any_camera[:, 0, 0])
    rows = odometry.keyframe_rows[posed].tolist()
    of_rows = [cameras[odometry.frames.capture[row]] for row in rows]
    return sample_surface(map(depth_of, rows), of_rows, T_any_camera[posed])


def _write_trajectories(draft: Path, odometry: Odometry, T_world_camera: Array) -> None:
    """One file a capture, of the frames that have a pose."""
    frames, known = odometry.frames, np.isfinite(T_world_camera[:, 0, 0])
    for c in np.unique(frames.capture):
        rows = known & (frames.capture == c)
        trajectory = Trajectory(frames.stamp_s[rows], T_world_camera[rows])
        write_tum(draft / f"trajectory_{c}.tum", trajectory)


def _write_other_parts(draft: Path, odometry: Odometry, solution: Solution) -> None:
    """The trajectories of each part that nothing joins to the main one, in a folder of its own."""
    for name, rows in solution.other_parts.items():
        (draft / name).mkdir()
        poses = np.full_like(solution.poses, np.nan)
        poses[rows] = solution.robust.graph.T_world_camera[rows]
        _write_trajectories(draft / name, odometry, poses)
