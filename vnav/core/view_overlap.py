"""How much of what one keyframe sees another sees, too, by their poses."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.mapping import FrameFeatures, Odometry

SAMPLE = 64  # points of a keyframe, of those with depth, that tell where it looks


def view_overlap(
    odometry: Odometry,
    T_world_camera: Array,
    part: NDArray[np.int32],
    cameras: Sequence[Intrinsics],
) -> Array:
    """Share (K, K) of two keyframes' points that lie in each other's image, the lesser of both.

    Zero on the diagonal and between frames of different parts (N,) of the pose graph.
    """
    rows, captures = odometry.keyframe_rows, odometry.frames.capture
    T_camera_world = se3.inverse(T_world_camera[rows])
    share = np.zeros((len(rows), len(rows)))
    for i, keyframe in enumerate(odometry.keyframes):
        points = _sampled_points(keyframe)
        in_camera = se3.transform(T_camera_world @ T_world_camera[rows[i]], points)
        for c, camera in enumerate(cameras):
            of_camera = captures[rows] == c
            px = camera.project(in_camera[of_camera])
            inside = ((px >= 0) & (px < camera.size)).all(-1)
            share[i, of_camera] = inside.mean(1) if len(points) else 0.0
    same_part = part[rows][:, None] == part[rows]
    overlap = np.where(same_part, np.minimum(share, share.T), 0.0)
    np.fill_diagonal(overlap, 0.0)
    return overlap


def _sampled_points(keyframe: FrameFeatures) -> NDArray[np.float32]:
    """About `SAMPLE` (S, 3) of a keyframe's 3D points."""
    points = keyframe.points_camera[keyframe.has_depth]
    return points[:: max(1, len(points) // SAMPLE)]
