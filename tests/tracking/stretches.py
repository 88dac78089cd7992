"""Some frames of a walk through a rendered scene, with exact poses."""

from collections.abc import Sequence

import numpy as np

from vnav.core.camera import Camera
from vnav.io.sources.memory import ArrayCapture, frames
from vnav.synthetic import MINIATURE, SCENES, CaptureSpec, Sensor
from vnav.synthetic.path import frames_at
from vnav.synthetic.rendered_capture import camera_poses, exposed_frame, with_walkers
from vnav.synthetic.sensor import measured_color, measured_depth

STEP_M, UNEVEN = 0.07, 0.43  # 4 to 10 cm a frame
RATE_HZ = 10.0
KINECT_LIKE = Sensor()


def stretch(
    scene: str, seed: int, rows: Sequence[int], sensor: Sensor = KINECT_LIKE
) -> tuple[ArrayCapture, np.ndarray]:
    """Those frames of the walk through a scene, and their T_world_camera."""
    camera, count = MINIATURE.camera, frames_at(STEP_M, SCENES[scene](seed).tour)
    spec = CaptureSpec(
        scene, count, 0, camera, camera, RATE_HZ, seed=seed, uneven=UNEVEN, sensor=sensor
    )
    return stretch_of(spec, rows)


def stretch_of(spec: CaptureSpec, rows: Sequence[int]) -> tuple[ArrayCapture, np.ndarray]:
    """Those frames of a capture, and their T_world_camera."""
    scene = SCENES[spec.scene](spec.seed)
    place = with_walkers(scene, spec) or scene
    T_world_camera = camera_poses(place, spec)[rows]
    color, depth_m = [], []
    for row in rows:
        rng = np.random.default_rng([spec.seed, row])
        clean, exact_m = exposed_frame(place, spec, row)
        color.append(measured_color(clean, np.ones(3), spec.sensor, rng))
        depth_m.append(measured_depth(exact_m, spec.camera, spec.sensor, rng))
    stamps_s = np.array(rows) / spec.rate_hz
    return frames(color, depth_m, Camera(spec.camera, 1.0), stamps_s), T_world_camera
