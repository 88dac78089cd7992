"""A camera that turns to and fro before a post in the corner of a room; its depth may be late."""

import numpy as np

from tests.masking.moving_box import CAMERA
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.reduced_frame import ReducedFrame

RATE_HZ, SIGMA_PER_M2 = 30.0, 0.0014
TURN_RAD, TURN_S, SWAY_M = 0.5, 2.0, 0.1  # at most 1.6 rad/s: 3 blocks in 30 ms
WALL_M, SIDE_M, POST_M, HALF_POST_M = 3.0, 1.5, 1.8, 0.2


def pose_at(stamp_s: float) -> Array:
    """T_world_camera at a time: x to the right, z ahead."""
    phase = 2 * np.pi * stamp_s / TURN_S
    R = se3.exp_so3(np.array([0, TURN_RAD * np.sin(phase), 0]))
    return se3.make(R, [SWAY_M * np.cos(phase), 0, 0])


def frame_at(stamp_s: float, delay_s: float) -> ReducedFrame:
    """Nothing moves. Brightness is even, so that depth alone tells."""
    rows, columns = np.indices((CAMERA.height, CAMERA.width))
    T = pose_at(stamp_s + delay_s)
    ray = CAMERA.unproject(np.stack([columns, rows], -1), np.ones(rows.shape)) @ T[:3, :3].T
    x_m = T[0, 3]
    ahead, aside = (WALL_M - T[2, 3]) / ray[..., 2], (SIDE_M - x_m) / ray[..., 0]
    depth_m = np.minimum(ahead, np.where(aside > 0, aside, np.inf))
    post_m = (POST_M - T[2, 3]) / ray[..., 2]
    on_post = np.abs(x_m + post_m * ray[..., 0]) < HALF_POST_M
    depth_m = np.where(on_post, post_m, depth_m)  # along the ray as along the axis: z of it is 1
    noise = np.random.default_rng(round(RATE_HZ * stamp_s)).standard_normal(rows.shape)
    grey = np.full(rows.shape, 120, np.float32)
    return ReducedFrame(stamp_s, grey, 1 / depth_m + SIGMA_PER_M2 * noise, CAMERA)
