"""Some frames of a walk through a rendered scene, with exact poses."""

from collections.abc import Sequence

import numpy as np

from vnav.core.camera import Camera
from vnav.io.sources.memory import ArrayCapture, frames
from vnav.synthetic import MINIATURE, SCENES, CaptureSpec, Sensor
from vnav.synthetic.path import frames_at
from vnav.synthetic.rendered_capture import camera_poses
from vnav.synthetic.sensor import measured_color, measured_depth

STEP_M, UNEVEN = 0.07, 0.43  # 4 to 10 cm a frame
RATE_HZ = 10.0
KINECT_LIKE = Sensor()


def stretch(
    scene: str, seed: int, rows: Sequence[int], sensor: Sensor = KINECT_LIKE
) -> tuple[ArrayCapture, np.ndarray]:
    """Those frames of the walk through a scene, and their T_world_camera."""
    place, camera = SCENES[scene](seed), MINIATURE.camera
    count = frames_at(STEP_M, place.tour)
    spec = CaptureSpec(
        scene, count, 0, camera, camera, RATE_HZ, seed=seed, uneven=UNEVEN, sensor=sensor
    )
    T_world_camera = camera_poses(place, spec)[rows]
    color, depth_m = [], []
    for row, T in zip(rows, T_world_camera, strict=True):
        rng = np.random.default_rng([seed, row])
        clean, exact_m = place.render(camera, T)
        color.append(measured_color(clean, np.ones(3), spec.sensor, rng))
        depth_m.append(measured_depth(exact_m, camera, spec.sensor, rng))
    stamps_s = np.array(rows) / RATE_HZ
    return frames(color, depth_m, Camera(camera, 1.0), stamps_s), T_world_camera
