"""A Kinect-like sensor: what it makes of exact depth and of the colour that falls into it."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.core.camera import Intrinsics


@dataclass(frozen=True)
class Sensor:
    """Noise of depth and colour; see docs/synthetic.md.

    Source of the depth model: Khoshelham and Elberink 2012 (sigma = 1.425 mm at 1 m, growing with
    depth squared); Nguyen, Izadi and Lovell 2012 (loss at grazing angles).
    """

    min_depth_m: float = 0.45
    max_depth_m: float = 5.5
    depth_sigma_per_m2: float = 0.0015  # axial sigma = this * depth^2
    focal_baseline_px_m: float = 43.5  # disparity = this / depth
    disparity_step_px: float = 0.125
    edge_jump: float = 0.05  # relative jump of depth between neighbours that makes an edge
    edge_reach_px: int = 1
    edge_loss: float = 0.7  # share of pixels lost along edges
    grazing_deg: float = 80.0  # half is lost at this angle between ray and normal
    color_sigma: float = 2.0  # of 255
    gain_drift: float = 0.06  # amplitude of the slow change of exposure
    jpeg_quality: int = 92
    exposure_s: float = 0.0  # of a row of colour; what moves meanwhile is blurred
    line_delay_s: float = 0.0  # from one row of colour to the next: a rolling shutter
    depth_delay_s: float = 0.0  # depth is measured so much after colour's stamp, all rows at once


def measured_depth(
    depth_m: NDArray[np.float32], intrinsics: Intrinsics, sensor: Sensor, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Depth (H, W) as the sensor gives it: noisy, in disparity steps, 0 where it has none."""
    seen = (depth_m >= sensor.min_depth_m) & (depth_m <= sensor.max_depth_m)
    z = np.where(seen, depth_m, 1).astype(np.float64)
    sigma_px = sensor.depth_sigma_per_m2 * sensor.focal_baseline_px_m
    disparity = sensor.focal_baseline_px_m / z + sigma_px * rng.standard_normal(z.shape)
    disparity = np.rint(disparity / sensor.disparity_step_px) * sensor.disparity_step_px
    chance = rng.random((2, *z.shape))
    at_edge = _edges(depth_m, sensor) & (chance[0] < sensor.edge_loss)
    steep = (_incidence_deg(depth_m, intrinsics) - sensor.grazing_deg) / 2
    grazing = chance[1] < 1 / (1 + np.exp(-steep))
    kept = seen & ~at_edge & ~grazing & (disparity > 0)
    noisy = sensor.focal_baseline_px_m / np.where(kept, disparity, 1)
    return np.where(kept, noisy, 0).astype(np.float32)


def measured_color(
    color: NDArray[np.uint8], gain: NDArray[np.float64], sensor: Sensor, rng: np.random.Generator
) -> NDArray[np.uint8]:
    """The image (H, W, 3) under a gain (3,) for R, G, B, with noise."""
    noise = sensor.color_sigma * rng.standard_normal(color.shape, np.float32)
    noisy = color * gain.astype(np.float32) + noise
    return np.asarray(np.clip(noisy + 0.5, 0, 255), np.uint8)


def gains(
    stamps_s: NDArray[np.float64], sensor: Sensor, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Gain (N, 3) of R, G, B over time: slow exposure, slower white balance."""
    t = stamps_s[:, None] - stamps_s[:1]
    exposure = np.sin(2 * np.pi * (t / 11.0 + rng.random()))
    balance = np.sin(2 * np.pi * (t / 37.0 + rng.random(3)))
    return np.asarray(1 + sensor.gain_drift * (exposure + 0.3 * balance))


def _edges(depth_m: NDArray[np.float32], sensor: Sensor) -> NDArray[np.bool_]:
    kernel = np.ones((3, 3), np.uint8)
    jump = cv2.dilate(depth_m, kernel) - cv2.erode(depth_m, kernel)
    edge = (jump > sensor.edge_jump * depth_m).astype(np.uint8)
    reach = np.ones((2 * sensor.edge_reach_px + 1,) * 2, np.uint8)
    return np.asarray(cv2.dilate(edge, reach) > 0)


def _incidence_deg(depth_m: NDArray[np.float32], intrinsics: Intrinsics) -> NDArray[np.float64]:
    """Angle (H, W) between ray and surface normal; the inverse depth of a plane is A x + B y + C.

    There (A, B, C) is along the normal, for normalised coordinates x, y.
    """
    inverse = 1 / np.where(depth_m > 0, depth_m, np.inf).astype(np.float64)
    B, A = np.gradient(inverse)
    A, B = A * intrinsics.fx, B * intrinsics.fy
    x = (np.arange(intrinsics.width) - intrinsics.cx) / intrinsics.fx
    y = ((np.arange(intrinsics.height) - intrinsics.cy) / intrinsics.fy)[:, None]
    C = inverse - A * x - B * y
    lengths = np.sqrt(A**2 + B**2 + C**2) * np.sqrt(x**2 + y**2 + 1)
    return np.asarray(np.rad2deg(np.arccos(np.clip(inverse / np.maximum(lengths, 1e-12), 0, 1))))
