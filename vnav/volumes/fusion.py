"""Keyframes' depth fused to one cloud, octree and mesh: claim 3, S8."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.config import FuseConfig
from vnav.core import se3
from vnav.core.frame import Frame
from vnav.core.point_cloud import Mesh, PointCloud
from vnav.core.progress import Progress, silent
from vnav.volumes.cloud import VoxelCloud, filter_depth, first_in_voxel
from vnav.volumes.octree import Octree


@dataclass(frozen=True)
class PosedFrame:
    """A keyframe and the pose of its camera."""

    frame: Frame
    T_world_camera: NDArray[np.float64]


@dataclass(frozen=True)
class FusedVolumes:
    """Three pictures of the same space."""

    cloud: PointCloud
    octree: Octree
    mesh: Mesh


def fuse(
    views: Iterable[PosedFrame], count: int, config: FuseConfig, progress: Progress = silent
) -> FusedVolumes:
    """Put every view into a cloud, an octree and a signed distance volume; one view in memory.

    ``count``: of the views, for ``progress``.
    """
    from vnav.volumes.tsdf import TsdfVolume

    cloud, octree = VoxelCloud(config.voxel_m), Octree(config.octree_m)
    volume = TsdfVolume(config.mesh_voxel_m, config.max_range_m)
    for done, view in enumerate(views, 1):
        depth_m = filter_depth(view.frame.depth_m, config)
        v, u = np.nonzero(depth_m)
        points_camera = view.frame.intrinsics.unproject(np.stack([u, v], -1), depth_m[v, u])
        points_world = se3.transform(view.T_world_camera, points_camera)
        sensor_world = view.T_world_camera[:3, 3]

        stride = max(1, int(config.voxel_m * view.frame.intrinsics.fx / config.max_range_m))
        sampled = (u % stride == 0) & (v % stride == 0)  # still a point a voxel at the far end
        cloud.add(points_world[sampled], view.frame.color[v[sampled], u[sampled]])
        octree.insert(points_world[first_in_voxel(points_world, config.octree_m)], sensor_world)
        volume.integrate(depth_m, view.frame.color, view.frame.intrinsics, view.T_world_camera)
        progress("fuse", done, count)
    octree.settle()
    return FusedVolumes(cloud.cloud(), octree, volume.mesh())
