"""Keyframes' depth fused to one cloud, octree and mesh: claim 3, S8; what has left: 003 S6."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.config import FuseConfig
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import Frame
from vnav.core.point_cloud import Mesh, PointCloud
from vnav.core.progress import Progress, silent
from vnav.threads import made_ahead
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
    view_of: Callable[[int], PosedFrame],
    history: DepthHistory,
    config: FuseConfig,
    progress: Progress = silent,
) -> FusedVolumes:
    """Put every view into a cloud, an octree and a signed distance volume; few are in memory.

    ``view_of`` reads a view by its number in the ``history``: depth of all of them, which tells
    what of each has departed since. Several threads call it.
    """
    from vnav.volumes.tsdf import TsdfVolume

    cloud, scans = VoxelCloud(config.voxel_m), Scans(config.octree_m)
    volume = TsdfVolume(config.mesh_voxel_m, config.max_range_m)
    departed = [np.zeros((0, 3))]
    for seen in made_ahead(lambda k: _seen_by(k, view_of(k), history, config), range(len(history))):
        frame, T_world_camera = seen.view.frame, seen.view.T_world_camera
        scans.insert(seen.scan_world, T_world_camera[:3, 3])
        cloud.add(seen.points_world, seen.colors)
        volume.integrate(seen.depth_m, frame.color, frame.intrinsics, T_world_camera)
        departed.append(seen.departed_world)
        progress("fuse", len(departed) - 1, len(history))
    points = np.concatenate(departed)
    points = points[voxels_of(points, config.octree_m)[0]]
    whole_cloud, octree = cloud.cloud(), scans.octree()
    del cloud, scans  # the mesh wants their memory
    return FusedVolumes(whole_cloud, octree, volume.mesh(), points)


@dataclass(frozen=True)
class _TrustedView:
    """What of a view is fused: depth that can be trusted, of what has not departed since.

    ``view``: all of it; ``scan_world`` (S, 3): a point in each voxel of the octree;
    ``points_world`` (N, 3) and ``colors`` (N, 3) for the cloud; ``depth_m`` (H, W), 0 elsewhere;
    ``departed_world`` (D, 3): a point in each voxel of the octree where something departed.
    """

    view: PosedFrame
    scan_world: Array
    points_world: Array
    colors: NDArray[np.uint8]
    depth_m: NDArray[np.float32]
    departed_world: Array


def _seen_by(k: int, view: PosedFrame, history: DepthHistory, config: FuseConfig) -> _TrustedView:
    """What of the view with number k in the history is fused."""
    color, camera = view.frame.color, view.frame.intrinsics
    depth_m = filter_depth(view.frame.depth_m, config)
    on_lattice = np.zeros(depth_m.shape, bool)
    stride = max(1, int(config.voxel_m * camera.fx / config.max_range_m))
    on_lattice[::stride, ::stride] = True  # a point a voxel far away
    v, u = np.nonzero(depth_m)
    z = depth_m[v, u]
    points_world = se3.transform(view.T_world_camera, camera.unproject(np.stack([u, v], -1), z))

    first, voxel = voxels_of(points_world, config.octree_m)
    places = points_world[first]
    gone = history.departed_since(k, places, z[first])
    left = gone[voxel]
    depth_m[v[left], u[left]] = 0
    sampled = on_lattice[v, u] & ~left
    colors = color[v[sampled], u[sampled]]
    return _TrustedView(view, places[~gone], points_world[sampled], colors, depth_m, places[gone])
