"""One robust pose graph over all frames, then landmarks and bundle adjustment: claim 3, S7."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress, pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vnav import posegraph
from vnav.bundle import Prior, SensorModel
from vnav.config import Config
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.frame import Edge
from vnav.core.mapping import LOST, LoopVerdict, Odometry, OptimisedMap
from vnav.core.progress import Progress, silent
from vnav.core.report import Report
from vnav.core.trajectory import Trajectory
from vnav.errors import ConfigError
from vnav.io.artifacts import (
    load_keyframe,
    load_loop_edges,
    load_loops,
    load_odometry,
    map_camera,
    save_optimised,
    save_verdicts,
)
from vnav.io.map_folder import MapFolder
from vnav.io.trajectories import write_tum
from vnav.posegraph import softened
from vnav.stages.common import clock, finished, reused, settings_of
from vnav.stages.given import noise
from vnav.stages.landmarks import Adjusted, Tracks, adjust_landmarks
from vnav.stages.world import find_world, in_given, kept_world, seen_surface

Array = NDArray[np.float64]


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
        posegraph.write_g2o(str(draft / "graph.g2o"), result.T_world_camera, edges)
    return finished(folder, _report(solved, result, odometry), started)


@dataclass(frozen=True)
class Solved:
    """Poses (N, 4, 4) of the main part, its adjusted keyframes and landmarks, closures kept.

    ``others``: rows of the parts that no closure joins to it, by name, the largest first;
    ``prior``: of keyframes whose poses were given.
    """

    poses: Array
    adjusted: Adjusted
    graph: posegraph.PoseGraph
    closures: tuple[Edge, ...]
    others: dict[str, NDArray[np.intp]]
    prior: Prior | None = None


def solve(
    odometry: Odometry,
    closures: Sequence[Edge],
    matches: NDArray[np.int32],
    cameras: Sequence[Intrinsics],
    config: Config,
    progress: Progress = silent,
) -> Solved:
    """Robust pose graph, bundle adjustment of the keyframes, then the frames between them.

    There is no pose graph where poses are given: `config.OptimiseConfig.given_poses` says whether
    they stay as they are or are a prior.
    """
    if odometry.given:
        return _on_given(odometry, closures, matches, cameras, config)
    segments = odometry.T_segment_camera, odometry.segment, odometry.frames.capture
    initial, _ = posegraph.join(*segments, closures)
    graph = posegraph.optimise(
        initial, odometry.edges, closures, config.optimise.max_closure_sigmas
    )
    _, part = posegraph.join(*segments, list(compress(closures, graph.kept)))
    inside = np.array([part[e.i] == part[e.j] for e in closures], bool)
    graph = dataclasses.replace(graph, kept=graph.kept & inside)
    kept = tuple(compress(closures, graph.kept))
    main, others = _parts(part, odometry.T_world_before)
    poses = np.where(main[:, None, None], graph.T_world_camera, np.nan)
    edges = [e for e in (*odometry.edges, *kept) if main[e.i] and main[e.j]]
    progress("optimise", 1, 3)
    adjusted = _adjust(poses, odometry, kept, matches, cameras, config)
    progress("optimise", 2, 3)
    poses = _carried(poses, adjusted, odometry, edges)
    poses, others = _hung(poses, odometry, others, config.odometry.max_depth_only_frames)
    progress("optimise", 3, 3)
    return Solved(poses, adjusted, graph, kept, others)


def _on_given(
    odometry: Odometry,
    closures: Sequence[Edge],
    matches: NDArray[np.int32],
    cameras: Sequence[Intrinsics],
    config: Config,
) -> Solved:
    """Which closures agree with the given poses, and the landmarks that their matches make."""
    poses = odometry.T_segment_camera
    sigmas, fixed = noise(poses, closures), _is_fixed(config)
    rad, m = np.sqrt(2) * sigmas[[0, 3]]  # of two poses
    graph = posegraph.held(
        poses, [softened(e, rad, m) for e in closures], config.optimise.max_closure_sigmas
    )
    kept = tuple(compress(closures, graph.kept))
    rows = np.array([k.row for k in odometry.keyframes])
    prior = Prior(poses[rows], sigmas, fixed)
    adjusted = _adjust(poses, odometry, kept, matches, cameras, config, prior)
    if not fixed:
        poses = _carried(poses, adjusted, odometry, odometry.edges)
    return Solved(poses, adjusted, graph, kept, {}, prior)


def _is_fixed(config: Config) -> bool:
    how = config.optimise.given_poses
    if how not in ("fixed", "prior"):
        raise ConfigError(f"expected fixed or prior for optimise.given_poses, found '{how}'")
    return how == "fixed"


def judged(verdicts: Sequence[LoopVerdict], graph: posegraph.PoseGraph) -> list[LoopVerdict]:
    """The verdicts, with the closures that the pose graph did not bear out turned down."""
    kept = iter(graph.kept)
    return [
        verdict
        if not verdict.accepted or next(kept)
        else dataclasses.replace(verdict, accepted=False, reason="disagrees with the pose graph")
        for verdict in verdicts
    ]


def _parts(
    part: NDArray[np.int32], T_world_before: Array | None = None
) -> tuple[NDArray[np.bool_], dict[str, NDArray[np.intp]]]:
    """Which frames are in the main part, and the rows of the others; a frame alone is none.

    The main part is the largest; of an extended map, the one with most of what was mapped before.
    """
    numbers, sizes = np.unique(part[part != LOST], return_counts=True)
    if T_world_before is not None:
        mapped = part[np.isfinite(T_world_before[:, 0, 0])]
        sizes = sizes + len(part) * (mapped[:, None] == numbers).sum(0)
    main, *others = numbers[np.argsort(-sizes, kind="stable")]
    rows = [np.flatnonzero(part == number) for number in others]
    named = enumerate((r for r in rows if len(r) > 1), 2)
    return part == main, {f"part_{number}": r for number, r in named}


def _adjust(
    poses: Array,
    odometry: Odometry,
    closures: Sequence[Edge],
    matches: NDArray[np.int32],
    cameras: Sequence[Intrinsics],
    config: Config,
    prior: Prior | None = None,
) -> Adjusted:
    rows = [k.row for k in odometry.keyframes]
    number = {row: k for k, row in enumerate(rows)}
    kept = {(number[e.i], number[e.j]) for e in closures}
    of_kept = [(int(i), int(j)) in kept for i, j in matches[:, [0, 2]]]
    tracks = Tracks(odometry.keyframes, matches[np.array(of_kept, bool)])
    model = SensorModel([cameras[odometry.frames.capture[r]] for r in rows], config.registration)
    segment = odometry.segment[rows]
    known = np.isfinite(poses[rows, 0, 0])
    of_segment = [np.flatnonzero(segment == s).tolist() for s in np.unique(segment)]
    neighbours = {pair for keyframes in of_segment for pair in pairwise(keyframes)}
    joined = [(i, j) for i, j in sorted(neighbours | kept) if known[i] and known[j]]
    return adjust_landmarks(poses[rows], tracks, joined, model, config.optimise, prior)


def _carried(poses: Array, adjusted: Adjusted, odometry: Odometry, edges: Sequence[Edge]) -> Array:
    """All poses, where the keyframes' are those of the adjustment."""
    rows = np.array([k.row for k in odometry.keyframes])
    poses = _moved_along(poses, adjusted.T_world_camera, rows)
    return posegraph.carry(poses, edges, rows[np.isfinite(poses[rows, 0, 0])])


def _hung(
    poses: Array, odometry: Odometry, others: dict[str, NDArray[np.intp]], most: int
) -> tuple[Array, dict[str, NDArray[np.intp]]]:
    """All poses, with those of frames that only depth joins to the rest; and the parts left.

    Parts of more frames than ``most`` stay parts: nothing is built on depth alone.
    """
    large = [rows for rows in others.values() if len(rows) > most]
    apart = np.isin(np.arange(len(poses)), np.concatenate([[-1], *large]))
    edges = [e for e in (*odometry.edges, *odometry.depth_edges) if not (apart[e.i] or apart[e.j])]
    held = np.flatnonzero(np.isfinite(poses[:, 0, 0]))
    poses = posegraph.reached(poses, edges)
    known = np.isfinite(poses[:, 0, 0])
    if known.sum() > len(held):
        poses = posegraph.carry(poses, [e for e in edges if known[e.i] and known[e.j]], held)
    return poses, {name: rows for name, rows in others.items() if not known[rows].any()}


def _moved_along(poses: Array, adjusted: Array, rows: NDArray[np.intp]) -> Array:
    """All poses, each moved as the keyframe before it was moved by the adjustment."""
    good = np.isfinite(adjusted[:, 0, 0])
    rows, correction = rows[good], (adjusted @ se3.inverse(poses[rows]))[good]
    before = np.searchsorted(rows, np.arange(len(poses)), side="right") - 1
    return np.asarray(correction[before.clip(0)] @ poses)


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
    depths = [load_keyframe(folder, row, odometry.frames).depth_m for row in rows]
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
    if solved.prior:
        rad, m = solved.prior.sigmas[[0, 3]]
        values |= {"given_sigma_deg": float(np.rad2deg(rad)), "given_sigma_m": float(m)}
        lines = (*lines, _told(solved.prior))
    warnings = []
    for name, rows in solved.others.items():
        warnings.append(
            f"{odometry.frames.told(rows)} are a part of their own, for no loop joins them to the"
            f" rest: their trajectory is in optimise/{name}, the map is of the main part"
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


def _told(prior: Prior) -> str:
    how = "fixed" if prior.fixed else "adjusted"
    if not prior.sigmas.any():
        return f"given poses {how}: loops show no noise in them beyond their own"
    rad, m = prior.sigmas[[0, 3]]
    return f"given poses {how}: loops show noise of {np.rad2deg(rad):.2f} deg and {1000 * m:.0f} mm"
