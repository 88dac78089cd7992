"""One robust pose graph over all frames, then landmarks and bundle adjustment: claim 3, S7."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vnav.config import Config
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.mapping import LoopVerdict, Odometry, OptimisedMap
from vnav.core.progress import Progress, silent
from vnav.core.report import Report
from vnav.core.trajectory import Trajectory
from vnav.io.formats.trajectories import write_tum
from vnav.io.store.artifacts import (
    load_keyframe_depth,
    load_loop_edges,
    load_loops,
    load_odometry,
    map_camera,
    save_optimised,
    save_verdicts,
)
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.stage_reports import clock, finished, reused, settings_of
from vnav.optimisation import pose_graph
from vnav.optimisation.bundle import Prior
from vnav.optimisation.solution import Solved, solve
from vnav.optimisation.world import find_world, in_given, kept_world, seen_surface
from vnav.threads import one_blas_thread


@one_blas_thread
def run(folder: MapFolder, config: Config, *, progress: Progress = silent) -> Report:
    """Final poses of all frames, landmarks, and the world frame."""
    started = clock()
    settings = settings_of(config, "registration", "odometry", "optimise")
    inputs = folder.inputs_of("odometry", "loops")
    if folder.is_current("optimise", settings, inputs):
        return reused(folder, "optimise")
    odometry, (closures, matches) = load_odometry(folder), load_loop_edges(folder)
    cameras = [map_camera(folder, k) for k in range(len(folder.captures))]
    solved = solve(odometry, closures, matches, cameras, config, progress)
    result = stand_up(folder, solved, odometry, cameras, config)
    with folder.writing("optimise", settings, inputs) as draft:
        save_optimised(draft, result)
        save_verdicts(draft, judged(load_loops(folder, "loops"), solved.graph))
        _write_trajectories(draft, odometry, result.T_world_camera)
        for name, rows in solved.others.items():
            (draft / name).mkdir()
            poses = np.full_like(solved.poses, np.nan)
            poses[rows] = solved.graph.T_world_camera[rows]
            _write_trajectories(draft / name, odometry, poses)
        edges = [*odometry.edges, *solved.closures]
        pose_graph.write_g2o(str(draft / "graph.g2o"), result.T_world_camera, edges)
    return finished(folder, _report(solved, result, odometry), started)


def judged(verdicts: Sequence[LoopVerdict], graph: pose_graph.PoseGraph) -> list[LoopVerdict]:
    """The verdicts, with the closures that the pose graph did not bear out turned down."""
    kept = iter(graph.kept)
    return [
        verdict
        if not verdict.accepted or next(kept)
        else dataclasses.replace(verdict, accepted=False, reason="disagrees with the pose graph")
        for verdict in verdicts
    ]


def stand_up(
    folder: MapFolder,
    solved: Solved,
    odometry: Odometry,
    cameras: Sequence[Intrinsics],
    config: Config,
) -> OptimisedMap:
    """The solution in the world frame: z up, floor at z = 0.

    Given poses keep their own world, an extended map the one it had.
    """
    T_any_camera = solved.adjusted.T_world_camera
    numbers = np.flatnonzero(np.isfinite(T_any_camera[:, 0, 0]))
    rows = [odometry.keyframes[k].row for k in numbers]
    depths = (load_keyframe_depth(folder, row) for row in rows)
    intrinsics = [cameras[odometry.frames.capture[row]] for row in rows]
    surface = seen_surface(depths, intrinsics, T_any_camera[numbers], config.odometry.max_depth_m)
    rng = np.random.default_rng([config.seed, 2])
    T_world_any, world = find_world(surface, T_any_camera[numbers], rng)
    first, T_floor_any = T_any_camera[numbers[0]], T_world_any
    if odometry.given:
        T_world_any, world = np.eye(4), in_given(world, T_floor_any, first)
    elif odometry.T_world_before is not None:
        T_world_any = kept_world(odometry.T_world_before, solved.poses)
        T_floor_world = T_floor_any @ se3.inverse(T_world_any)
        world = in_given(world, T_floor_world, T_world_any @ first, "kept")
    landmarks = solved.adjusted.landmarks
    points = se3.transform(T_world_any, landmarks.points_world).astype(np.float32)
    return OptimisedMap(
        T_world_any @ solved.poses,
        solved.adjusted.covariance,
        dataclasses.replace(landmarks, points_world=points),
        world,
    )


def _write_trajectories(draft: Path, odometry: Odometry, T_world_camera: Array) -> None:
    """One file a capture, of the frames that have a pose."""
    frames, known = odometry.frames, np.isfinite(T_world_camera[:, 0, 0])
    for c in np.unique(frames.capture):
        rows = known & (frames.capture == c)
        trajectory = Trajectory(frames.stamp_s[rows], T_world_camera[rows])
        write_tum(draft / f"trajectory_{c}.tum", trajectory)


def _report(solved: Solved, result: OptimisedMap, odometry: Odometry) -> Report:
    posed = int(np.isfinite(result.T_world_camera[:, 0, 0]).sum())
    adjusted, kept = solved.adjusted, len(solved.closures)
    rejected = len(solved.graph.kept) - kept
    values = {
        "frames": len(odometry.frames),
        "posed": posed,
        "parts": [
            {"first": int(r[0]), "last": int(r[-1]), "frames": len(r)}
            for r in (np.flatnonzero(np.isfinite(solved.poses[:, 0, 0])), *solved.others.values())
        ],
        "closures_kept": kept,
        "closures_rejected": rejected,
        "graph_error_before": solved.graph.error_before,
        "graph_error_after": solved.graph.error_after,
        "depth_offset": adjusted.depth_offset,
        "landmarks": len(adjusted.landmarks),
        "observations": adjusted.observations,
        "rms_px_before": adjusted.rms_px_before if adjusted.observations else None,
        "rms_px_after": adjusted.rms_px_after if adjusted.observations else None,
        "world": result.world.source,
        "floor_points": result.world.floor_points,
    }
    landmarks = f"{len(adjusted.landmarks)} landmarks"
    if adjusted.observations:
        landmarks += (
            f"; reprojection {adjusted.rms_px_before:.2f} px before,"
            f" {adjusted.rms_px_after:.2f} px after bundle adjustment"
        )
    lines: tuple[str, ...] = (
        f"{posed} of {len(odometry.frames)} frames have a pose; {kept} closures kept,"
        f" {rejected} rejected",
        landmarks,
    )
    if adjusted.depth_offset:
        lines = (*lines, _short_or_long(adjusted.depth_offset))
    if solved.prior:
        rad, m = solved.prior.sigmas[[0, 3]]
        values |= {"given_sigma_deg": float(np.rad2deg(rad)), "given_sigma_m": float(m)}
        lines = (*lines, _told(solved.prior))
    warnings = []
    for name, rows in solved.others.items():
        warnings.append(
            f"{odometry.frames.rows_text(rows)} are a part of their own, for no loop joins them to"
            f" the rest: their trajectory is in optimise/{name}, the map is of the main part"
        )
    if odometry.given and rejected > kept:
        warnings.append(
            f"the given poses contradict the images: {rejected} of {kept + rejected} pairs of"
            " keyframes stand otherwise to each other; expected metres and camera to world, the"
            " camera's x right, y down, z forward"
        )
    if result.world.doubt:
        warnings.append(result.world.doubt)
    return Report("optimise", values, lines, tuple(warnings))


def _short_or_long(depth_offset: float) -> str:
    how = "short" if depth_offset > 0 else "long"
    off_mm = 1000 * abs(depth_offset) * 4**2
    return f"depth is {off_mm:.1f} mm too {how} at 4 m; poses and landmarks allow for it"


def _told(prior: Prior) -> str:
    how = "fixed" if prior.fixed else "adjusted"
    if not prior.sigmas.any():
        return f"given poses {how}: loops show no noise in them beyond their own"
    rad, m = prior.sigmas[[0, 3]]
    return f"given poses {how}: loops show noise of {np.rad2deg(rad):.2f} deg and {1000 * m:.0f} mm"
