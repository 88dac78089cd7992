"""Pairs of keyframes: how much both see by their poses, and which are apart in time."""

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
) -> NDArray[np.float32]:
    """Share (K, K) of two keyframes' points that lie in each other's image, the lesser of both.

    Zero on the diagonal and between frames of different parts (N,) of the pose graph.
    """
    rows, captures = odometry.keyframe_rows, odometry.frames.capture
    T = T_world_camera[rows]
    of_keyframes = [cameras[c] for c in captures[rows]]
    P = np.stack([c.K for c in of_keyframes]) @ se3.inverse(T)[:, :3]
    width, height = np.array([c.size for c in of_keyframes], float).T[..., None]
    share = np.zeros((len(rows), len(rows)), np.float32)
    for i, keyframe in enumerate(odometry.keyframes):
        points = se3.transform(T[i], _sampled_points(keyframe))
        known = np.concatenate([points.T, np.ones((1, len(points)))])
        u, v, z = (P.reshape(-1, 4) @ known).reshape(len(rows), 3, -1).swapaxes(0, 1)
        inside = (z > 0) & (u >= 0) & (u < width * z) & (v >= 0) & (v < height * z)
        share[i] = inside.mean(1) if len(points) else 0.0
    overlap = np.minimum(share, share.T)
    overlap[part[rows][:, None] != part[rows]] = 0.0
    np.fill_diagonal(overlap, 0.0)
    return overlap


def are_apart(odometry: Odometry, exclude_s: float) -> NDArray[np.bool_]:
    """Which keyframes (K, K) are far apart in time, or of different segments or captures."""
    frames, rows = odometry.frames, odometry.keyframe_rows
    stamp_s, segment, capture = frames.stamp_s[rows], odometry.segment[rows], frames.capture[rows]
    apart = np.abs(stamp_s[:, None] - stamp_s) > exclude_s
    apart |= segment[:, None] != segment
    return np.asarray(apart | (capture[:, None] != capture))


def _sampled_points(keyframe: FrameFeatures) -> NDArray[np.float32]:
    """About `SAMPLE` (S, 3) of a keyframe's 3D points."""
    points = keyframe.points_camera[keyframe.has_depth]
    return points[:: max(1, len(points) // SAMPLE)]
