"""How fast the camera moves as it takes a frame, by the poses of the frames beside it."""

import numpy as np
from numpy.typing import NDArray

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.mapping import FrameTable

REACH_S = 0.35  # of a frame beside, as at 3 Hz; one farther off tells nothing of the moment


def velocities(T_world_camera: Array, frames: FrameTable) -> Array:
    """Twist (N, 6) of the camera at each frame, in its own axes: rad/s, m/s, rotation first.

    From the poses (N, 4, 4) of the frames before and after it, or one of them and its own where
    the other is missing, of another capture or more than `REACH_S` away; 0 where both are.
    """
    row = np.arange(len(frames))
    joined = _joined(T_world_camera, frames)
    before = row - np.append(False, joined)
    after = row + np.append(joined, False)
    T_before, T, T_after = (T_world_camera[rows] for rows in (before, row, after))
    turned = se3.log_so3(np.swapaxes(T_before[:, :3, :3], 1, 2) @ T_after[:, :3, :3])
    moved = np.swapaxes(T[:, :3, :3], 1, 2) @ (T_after - T_before)[:, :3, 3:]
    passed_s = frames.stamp_s[after] - frames.stamp_s[before]
    known = (after > before)[:, None]
    motion = np.concatenate([turned, moved[..., 0]], 1) / np.where(known, passed_s[:, None], 1)
    return np.where(known, motion, 0.0)


def motions_after(T_world_camera: Array, frames: FrameTable, after_s: Array) -> Array:
    """Motion (N, 4, 4) of the camera from each frame's pose in a time (N,) of its own."""
    return se3.exp(velocities(T_world_camera, frames) * after_s[:, None])


def _joined(T_world_camera: Array, frames: FrameTable) -> NDArray[np.bool_]:
    """Which frames (N - 1,) and the next are of one capture, near in time, and have poses."""
    posed = np.isfinite(T_world_camera[:, 0, 0])
    step_s = np.diff(frames.stamp_s)
    same = np.diff(frames.capture) == 0
    return np.asarray(same & (step_s > 0) & (step_s < REACH_S) & posed[1:] & posed[:-1])
