"""Exposure while the camera moves: motion blur, and a shutter that opens row after row."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vnav.core.camera import Intrinsics
from vnav.synthetic.people import Peopled
from vnav.synthetic.scene import Scene
from vnav.synthetic.sensor import Sensor

SLICE_S = 0.001  # what is rendered at one pose: 1 px at 120 degrees a second and 500 px

PosesAt = Callable[[NDArray[np.float64]], NDArray[np.float64]]


def exposed_color(
    scene: Scene | Peopled,
    camera: Intrinsics,
    sensor: Sensor,
    poses_at: PosesAt,
    stamp_s: float = 0.0,
) -> NDArray[np.uint8]:
    """Colour (H, W, 3) of a moving camera: each row the mean over the time that it is exposed.

    ``poses_at`` gives T_world_camera (N, 4, 4) at times (N,) in seconds after the stamp, which is
    the middle of the middle row's exposure. A camera that exposes all at once and for no time is
    rendered at its stamp.
    """
    times_s, weights = _slices(camera.height, sensor)
    if len(times_s) == 1:
        return scene.at(stamp_s).render_color(camera, poses_at(times_s)[0])
    color = np.zeros((camera.height, camera.width, 3), np.float32)
    for after_s, T, weight in zip(times_s, poses_at(times_s), weights, strict=True):
        first, last = np.flatnonzero(weight)[[0, -1]].tolist()
        band = replace(camera, height=last + 1 - first, cy=camera.cy - first)
        rows = slice(first, last + 1)
        color[rows] += weight[rows, None, None] * scene.at(stamp_s + after_s).render_color(band, T)
    return np.asarray(np.rint(color), np.uint8)


def _slices(height: int, sensor: Sensor) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """Middles (N,) of the slices of time, and the share (N, height) of each row's light in them.

    The light-weighted mean time of a row is the middle of its exposure, exactly.
    """
    middles_s = sensor.line_delay_s * (np.arange(height) - (height - 1) / 2)
    if not (sensor.line_delay_s or sensor.exposure_s):
        return np.zeros(1), np.ones((1, height), np.float32)
    exposure_s = max(sensor.exposure_s, SLICE_S)
    opens, closes = middles_s - exposure_s / 2, middles_s + exposure_s / 2
    count = int(np.ceil((closes[-1] - opens[0]) / SLICE_S - 1e-9))
    ends = np.linspace(opens[0], closes[-1], count + 1)
    overlap = np.minimum(ends[1:, None], closes) - np.maximum(ends[:-1, None], opens)
    weights = (overlap.clip(0) / exposure_s).astype(np.float32)
    lit = weights.any(1)
    return ((ends[1:] + ends[:-1]) / 2)[lit], weights[lit]
