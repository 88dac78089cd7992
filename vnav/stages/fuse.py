"""The kept frames' depth made one cloud, octree, mesh and grid: claim 3, S8, and claim 5, 3.1."""

import dataclasses
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.config import Config, FuseConfig
from vnav.core.arrays import Array, Floats
from vnav.core.camera_motion import motions_after
from vnav.core.grid import FREE, STATES, Grid
from vnav.core.mapping import Landmarks, World
from vnav.core.progress import Progress, silent
from vnav.core.reduced_frame import BLOCK_PX, in_pixels
from vnav.core.report import Report
from vnav.errors import MapError
from vnav.io.formats.ply import write_cloud, write_mesh
from vnav.io.store.artifacts import (
    kept_rows,
    load_keyframe,
    load_keyframe_blocks,
    load_keyframe_depth,
    load_odometry,
    load_optimised,
    map_cameras,
    save_departed,
    save_grid,
)
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.stage_reports import clock, finished, reused, settings_of
from vnav.masking.remains import remains
from vnav.planning.projection import project
from vnav.planning.storeys import other_floor
from vnav.planning.walked import add_walked
from vnav.registration.reduction import reduced
from vnav.threads import one_blas_thread
from vnav.volumes.departed import DepthHistory, SeenDepth, seen_depth
from vnav.volumes.fusion import FusedVolumes, PosedFrame, fuse
from vnav.volumes.octree import Leaves, Octree

STAGE = "fuse"
BESIDE_PX = 3 * BLOCK_PX  # of what moves, not fused: its edge, and what a mask misses of an arm


@one_blas_thread
def run(folder: MapFolder, config: Config, *, progress: Progress = silent) -> Report:
    """Fuse the kept frames that have a pose; MapError where their depth holds nothing to fuse.

    Writes fuse/cloud.ply, occupancy.ot and .bt, mesh.ply, grid.pgm and .yaml, walked.pgm and .yaml,
    departed.npz.
    """
    started = clock()
    settings = settings_of(config, "registration", STAGE)
    inputs = folder.inputs_of("odometry", "optimise")
    if folder.is_current(STAGE, settings, inputs):
        return reused(folder, STAGE)
    optimised, views = load_optimised(folder), PosedFrames(folder)

    history = views.history(config)
    fused = fuse(views.view, history, config.fuse, progress)
    landmarks_departed = views.departed(optimised.landmarks, history)
    leaves = _leaves(fused.octree, config.fuse)
    walks = [] if optimised.world.doubt else views.walks()
    grid = _grid(leaves, walks, fused.cloud.points_world, config.fuse)

    with folder.writing(STAGE, settings, inputs) as draft:
        write_cloud(draft / "cloud.ply", fused.cloud)
        fused.octree.write(draft / "occupancy.ot")
        fused.octree.write(draft / "occupancy.bt")
        write_mesh(draft / "mesh.ply", fused.mesh)
        save_grid(draft, grid)
        save_departed(draft, landmarks_departed)

    report = _report(fused, leaves, grid, optimised.world, views)
    beside = _other_storey(walks, fused.cloud.points_world, config.fuse)
    report = dataclasses.replace(report, warnings=(*report.warnings, *beside))
    return finished(folder, report, started)


class PosedFrames:
    """The frames that a map keeps, keyframes or all, and that have a pose; read when asked for.

    The pose is that of the camera as it measured depth.
    """

    def __init__(self, folder: MapFolder) -> None:
        odometry, optimised = load_odometry(folder), load_optimised(folder)
        poses = optimised.T_world_camera
        poses = poses @ motions_after(poses, odometry.frames, optimised.depth_delay_s)
        self._folder, self._frames, self._poses = folder, odometry.frames, poses
        self._cameras, self._keyframe_rows = map_cameras(folder), odometry.keyframe_rows
        rows = np.union1d(self._keyframe_rows, kept_rows(folder, len(poses)))
        self._rows = rows[np.isfinite(poses[rows]).all((1, 2))].tolist()

    def __len__(self) -> int:
        return len(self._rows)

    @property
    def kind(self) -> str:
        """What they are."""
        return "keyframes" if np.isin(self._rows, self._keyframe_rows).all() else "frames"

    def __iter__(self) -> Iterator[PosedFrame]:
        return map(self.view, range(len(self)))

    def view(self, number: int) -> PosedFrame:
        """One of them, in order of time, without what moves and what its mask may leave of it."""
        row = self._rows[number]
        frame = load_keyframe(self._folder, row, self._frames, BESIDE_PX)
        moving = load_keyframe_blocks(self._folder, row)
        if moving is not None:
            left = remains(reduced(frame), moving, BESIDE_PX // BLOCK_PX)
            depth_m = np.where(in_pixels(left, frame.depth_m.shape), np.float32(0), frame.depth_m)
            frame = dataclasses.replace(frame, depth_m=depth_m)
        return PosedFrame(frame, self._poses[row])

    def walks(self) -> list[Array]:
        """For each capture, the camera's centres (F, 3) at all frames, NaN where not known."""
        return [self._poses[rows, :3, 3] for rows in self._frames.of_captures()]

    def history(self, config: Config) -> DepthHistory:
        """Their depth in order, which tells what has departed."""
        sigma_per_m2, fuse = config.registration.depth_sigma_per_m2, config.fuse
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            seen = pool.map(self._seen, self._rows)
            return DepthHistory(seen, sigma_per_m2, fuse.octree_m, fuse.departed_after)

    def _seen(self, row: int) -> SeenDepth:
        camera = self._cameras[self._frames.capture[row]]
        depth_m = load_keyframe_depth(self._folder, row, BESIDE_PX)
        return seen_depth(depth_m, camera, self._poses[row])

    def departed(self, landmarks: Landmarks, history: DepthHistory) -> NDArray[np.bool_]:
        """Which landmarks (L,) have departed since the last keyframe saw them."""
        number = np.searchsorted(self._rows, self._keyframe_rows)
        last_seen = np.zeros(len(landmarks), np.intp)
        np.maximum.at(last_seen, landmarks.landmark, number[landmarks.keyframe])
        return history.departed(landmarks.points_world, landmarks.sigma_m, last_seen)


def _leaves(octree: Octree, config: FuseConfig) -> Leaves:
    """The most likely state of all that was seen; MapError where nothing was."""
    leaves = octree.most_likely.leaves()
    if not len(leaves):
        raise MapError(
            "expected depth in the frames to fuse, found none within"
            f" {config.max_range_m:g} m; check the capture with 'vnav check', or raise the range"
            " with --set fuse.max_range_m=..."
        )
    return leaves


def _grid(leaves: Leaves, walks: Sequence[Array], points_world: Floats, config: FuseConfig) -> Grid:
    """The grid of the floor at ``floor_m``, with what was walked there."""
    down = np.array([0.0, 0.0, -config.floor_m])
    grid = project(leaves.centres_world + down, leaves.occupied, leaves.size_m, config)
    points = points_world + down.astype(np.float32)
    return add_walked(grid, [walk + down for walk in walks], points, config)


def _other_storey(
    walks: Sequence[Array], points_world: Floats, config: FuseConfig
) -> tuple[str, ...]:
    """A warning where cameras were carried over another floor than the grid's."""
    cameras = np.concatenate([np.zeros((0, 3)), *walks])
    floor_m = other_floor(cameras, points_world, config.floor_m)
    if floor_m is None:
        return ()
    return (
        f"there is another storey, its floor at {floor_m:.2f} m: the grid is of the floor at"
        f" {config.floor_m:g} m; for a grid of the other, run 'vnav fuse' with --set"
        f" fuse.floor_m={floor_m:.2f}",
    )


def _report(
    fused: FusedVolumes, leaves: Leaves, grid: Grid, world: World, views: PosedFrames
) -> Report:
    share = {name: float((grid.cells == state).mean()) for name, state in STATES.items()}
    area_m2 = {name: grid.area_m2(state) for name, state in STATES.items()}
    rows, columns = grid.cells.shape
    values: dict[str, Any] = {
        views.kind: len(views),
        "cloud_points": len(fused.cloud),
        "octree_cubes": len(leaves),
        "mesh_vertices": len(fused.mesh.vertices_world),
        "mesh_triangles": len(fused.mesh.triangles),
        "departed_voxels": len(fused.departed_world),
        "grid_m": [columns * grid.resolution_m, rows * grid.resolution_m],
        "share": {name: round(value, 4) for name, value in share.items()},
        "area_m2": area_m2,
    }
    shares = ", ".join(f"{value:.0%} {name}" for name, value in share.items())
    lines = [
        f"{len(views)} {views.kind} fused: cloud of {len(fused.cloud)} points, octree of"
        f" {len(leaves)} cubes, mesh of {len(fused.mesh.triangles)} triangles",
        f"grid {values['grid_m'][0]:.1f} x {values['grid_m'][1]:.1f} m: {shares};"
        f" {area_m2['free']:.1f} m2 free, {area_m2['occupied']:.1f} m2 occupied",
    ]
    if departed := len(fused.departed_world):
        lines.append(f"{departed} voxels were let go: later depth sees through them")
    return Report(STAGE, values, tuple(lines), tuple(_warnings(grid, world)))


def _warnings(grid: Grid, world: World) -> list[str]:
    found = []
    if world.doubt:
        found.append(f"the grid's heights may be wrong: {world.doubt}")
    if not grid.area_m2(FREE):
        found.append("no free floor was seen: no path can be planned on this map")
    return found
