"""Keyframes' depth fused to one cloud, octree and mesh: claim 3, S8; what has left: 003 S6."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.config import FuseConfig
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import Frame
from vnav.core.point_cloud import Mesh, PointCloud
from vnav.core.progress import Progress, silent
from vnav.volumes.cloud import VoxelCloud, filter_depth, voxels_of
from vnav.volumes.departed import DepthHistory
from vnav.volumes.octree import Octree, Scans


@dataclass(frozen=True)
class PosedFrame:
    """A keyframe and the pose of its camera."""

    frame: Frame
    T_world_camera: NDArray[np.float64]


@dataclass(frozen=True)
class FusedVolumes:
    """Three pictures of the same space, and what was left out of all of them.

    ``departed_world`` (N, 3): a point in each voxel of the octree where something departed.
    """

    cloud: PointCloud
    octree: Octree
    mesh: Mesh
    departed_world: Array


def fuse(
    views: Iterable[PosedFrame],
    history: DepthHistory,
    config: FuseConfig,
    progress: Progress = silent,
) -> FusedVolumes:
    """Put every view into a cloud, an octree and a signed distance volume; one view in memory.

    ``history``: depth of the same views, which tells what of each has departed since.
    """
    from vnav.volumes.tsdf import TsdfVolume

    cloud, scans = VoxelCloud(config.voxel_m), Scans(config.octree_m)
    volume = TsdfVolume(config.mesh_voxel_m, config.max_range_m)
    departed = [np.zeros((0, 3))]
    for k, view in enumerate(views):
        frame, seen = view.frame, _seen_by(view, config)
        first, voxel = voxels_of(seen.points_world, config.octree_m)
        places = seen[first]
        gone = history.departed_since(k, places.points_world, places.depth_m)
        departed.append(places.points_world[gone])
        scans.insert(places.points_world[~gone], view.T_world_camera[:3, 3])

        seen = seen[~gone[voxel]]
        stride = max(1, int(config.voxel_m * frame.intrinsics.fx / config.max_range_m))
        sampled = seen[(seen.u % stride == 0) & (seen.v % stride == 0)]  # a point a voxel far away
        cloud.add(sampled.points_world, frame.color[sampled.v, sampled.u])
        depth_m = seen.image(frame.depth_m.shape)
        volume.integrate(depth_m, frame.color, frame.intrinsics, view.T_world_camera)
        progress("fuse", k + 1, len(history))
    points = np.concatenate(departed)
    points = points[voxels_of(points, config.octree_m)[0]]
    return FusedVolumes(cloud.cloud(), scans.octree(), volume.mesh(), points)


@dataclass(frozen=True)
class _Pixels:
    """Pixels of a depth image: where they are (N,), their depth (N,), and points (N, 3)."""

    v: NDArray[np.intp]
    u: NDArray[np.intp]
    depth_m: NDArray[np.float32]
    points_world: Array

    def __getitem__(self, chosen: NDArray[np.intp] | NDArray[np.bool_]) -> "_Pixels":
        return _Pixels(
            self.v[chosen], self.u[chosen], self.depth_m[chosen], self.points_world[chosen]
        )

    def image(self, shape: tuple[int, ...]) -> NDArray[np.float32]:
        """Their depth, and 0 for all other pixels."""
        depth_m = np.zeros(shape, np.float32)
        depth_m[self.v, self.u] = self.depth_m
        return depth_m


def _seen_by(view: PosedFrame, config: FuseConfig) -> _Pixels:
    """The pixels of a view whose depth can be trusted."""
    depth_m = filter_depth(view.frame.depth_m, config)
    v, u = np.nonzero(depth_m)
    points_camera = view.frame.intrinsics.unproject(np.stack([u, v], -1), depth_m[v, u])
    return _Pixels(v, u, depth_m[v, u], se3.transform(view.T_world_camera, points_camera))
