"""The keyframes' depth made one cloud, octree, mesh and grid: claim 3, S8, and claim 5, 3.1."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.config import Config, FuseConfig
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.frame import Frame
from vnav.core.grid import FREE, OCCUPIED, UNKNOWN, Grid
from vnav.core.mapping import World
from vnav.core.point_cloud import Mesh, PointCloud
from vnav.core.progress import Progress, silent
from vnav.core.report import Report
from vnav.errors import MapError
from vnav.io.formats.grid_files import write_grid
from vnav.io.formats.ply import write_cloud, write_mesh
from vnav.io.store.artifacts import load_keyframe, load_odometry, load_optimised, map_camera
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.stage_reports import clock, finished, reused, settings_of
from vnav.planning.projection import project
from vnav.threads import one_blas_thread
from vnav.volumes.cloud import VoxelCloud, filter_depth, first_in_voxel
from vnav.volumes.octree import Leaves, Octree

STAGE = "fuse"


@one_blas_thread
def run(folder: MapFolder, config: Config, *, progress: Progress = silent) -> Report:
    """Fuse the keyframes that have a pose; MapError where their depth holds nothing to fuse.

    Writes fuse/cloud.ply, occupancy.ot and .bt, mesh.ply, grid.pgm and .yaml.
    """
    started = clock()
    settings, inputs = settings_of(config, STAGE), folder.inputs_of("odometry", "optimise")
    if folder.is_current(STAGE, settings, inputs):
        return reused(folder, STAGE)
    world = load_optimised(folder).world
    views = PosedFrames(folder)

    fused = fuse(views, config.fuse, progress)
    leaves, grid = _projected(fused.octree, config.fuse)

    with folder.writing(STAGE, settings, inputs) as draft:
        write_cloud(draft / "cloud.ply", fused.cloud)
        fused.octree.write(draft / "occupancy.ot")
        fused.octree.write(draft / "occupancy.bt")
        write_mesh(draft / "mesh.ply", fused.mesh)
        write_grid(draft, grid)

    return finished(folder, _report(fused, leaves, grid, world, len(views)), started)


@dataclass(frozen=True)
class PosedFrame:
    """A keyframe, its camera, and where that stood."""

    frame: Frame
    camera: Intrinsics
    T_world_camera: NDArray[np.float64]


class PosedFrames:
    """The keyframes of a map that have a pose, read one at a time."""

    def __init__(self, folder: MapFolder) -> None:
        odometry = load_odometry(folder)
        poses = load_optimised(folder).T_world_camera
        self._folder, self._frames, self._poses = folder, odometry.frames, poses
        self._rows = [k.row for k in odometry.keyframes if np.isfinite(poses[k.row]).all()]

    def __len__(self) -> int:
        return len(self._rows)

    def __iter__(self) -> Iterator[PosedFrame]:
        for row in self._rows:
            frame = load_keyframe(self._folder, row, self._frames)
            yield PosedFrame(frame, map_camera(self._folder, frame.capture), self._poses[row])


@dataclass(frozen=True)
class Fused:
    """Three pictures of the same space."""

    cloud: PointCloud
    octree: Octree
    mesh: Mesh


def fuse(views: PosedFrames, config: FuseConfig, progress: Progress = silent) -> Fused:
    """Put every view into a cloud, an octree and a signed distance volume; one view in memory."""
    from vnav.volumes.tsdf import TsdfVolume

    cloud, octree = VoxelCloud(config.voxel_m), Octree(config.octree_m)
    volume = TsdfVolume(config.mesh_voxel_m, config.max_range_m)
    for done, view in enumerate(views, 1):
        depth_m = filter_depth(view.frame.depth_m, config)
        v, u = np.nonzero(depth_m)
        points_camera = view.camera.unproject(np.stack([u, v], -1), depth_m[v, u])
        points_world = se3.transform(view.T_world_camera, points_camera)
        sensor_world = view.T_world_camera[:3, 3]

        stride = max(1, int(config.voxel_m * view.camera.fx / config.max_range_m))
        spread = (u % stride == 0) & (v % stride == 0)  # still a point a voxel at the far end
        cloud.add(points_world[spread], view.frame.color[v[spread], u[spread]])
        octree.insert(points_world[first_in_voxel(points_world, config.octree_m)], sensor_world)
        volume.integrate(depth_m, view.frame.color, view.camera, view.T_world_camera)
        progress(STAGE, done, len(views))
    octree.settle()
    return Fused(cloud.cloud(), octree, volume.mesh())


def _projected(octree: Octree, config: FuseConfig) -> tuple[Leaves, Grid]:
    leaves = octree.most_likely().leaves()
    if not len(leaves):
        raise MapError(
            "expected depth in the keyframes to fuse, found none within"
            f" {config.max_range_m:g} m; check the capture with 'vnav check', or raise the range"
            " with --set fuse.max_range_m=..."
        )
    return leaves, project(leaves.centres_world, leaves.occupied, leaves.size_m, config)


def _report(fused: Fused, leaves: Leaves, grid: Grid, world: World, keyframes: int) -> Report:
    states = {"free": FREE, "occupied": OCCUPIED, "unknown": UNKNOWN}
    share = {name: float((grid.cells == state).mean()) for name, state in states.items()}
    area_m2 = {name: round(grid.area_m2(state), 2) for name, state in states.items()}
    rows, columns = grid.cells.shape
    values: dict[str, Any] = {
        "keyframes": keyframes,
        "cloud_points": len(fused.cloud),
        "octree_cubes": len(leaves),
        "mesh_vertices": len(fused.mesh.vertices_world),
        "mesh_triangles": len(fused.mesh.triangles),
        "grid_m": [columns * grid.resolution_m, rows * grid.resolution_m],
        "share": {name: round(value, 4) for name, value in share.items()},
        "area_m2": area_m2,
    }
    shares = ", ".join(f"{value:.0%} {name}" for name, value in share.items())
    lines = (
        f"{keyframes} keyframes fused: cloud of {len(fused.cloud)} points, octree of"
        f" {len(leaves)} cubes, mesh of {len(fused.mesh.triangles)} triangles",
        f"grid {values['grid_m'][0]:.1f} x {values['grid_m'][1]:.1f} m: {shares};"
        f" {area_m2['free']:.1f} m2 free, {area_m2['occupied']:.1f} m2 occupied",
    )
    warnings = []
    if world.doubt:
        warnings.append(f"the grid's heights may be wrong: {world.doubt}")
    if not area_m2["free"]:
        warnings.append("no free floor was seen: no path can be planned on this map")
    return Report(STAGE, values, lines, tuple(warnings))
