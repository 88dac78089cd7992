"""A hand-held walk along a closed tour."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vnav.core import se3

STEP_RAD_PER_M = 1.0  # one radian takes as many frames as one metre
LENGTH_SAMPLES = 1000  # of a curve whose length is measured
TREMOR_HZ, ROLL_S = (0.5, 4.0), (4.0, 12.0)  # how fast a hand trembles, how slowly it rolls


@dataclass(frozen=True)
class Hand:
    """How the camera is held; it pans by ``pan_deg`` to either side, once in ``pan_frames``."""

    height_m: float
    pitch_deg: float
    pan_deg: float = 0.0
    pan_frames: float = 60.0


def walk(
    tour: NDArray[np.float64],
    frames: int,
    hand: Hand,
    rng: np.random.Generator,
    at: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Poses T_world_camera (frames, 4, 4) once around a tour of x, y, yaw, and height of the floor.

    The tour is (N, 4), or (N, 3) on a floor at z = 0.

    The frames are evenly spread in metres or radians, whichever is more; the last frame sees again
    what the first one saw. The hand sways a little, smoothly. ``at`` (M,): poses there instead,
    counted in frames, between them and beyond the ends, too.
    """
    at = np.arange(frames, dtype=float) if at is None else at
    x, y, yaw, *floor = _closed_curve(tour, frames, at)
    z = sum(floor) + hand.height_m + sway(at, 0.04, rng)
    yaw = yaw + sway(at, np.deg2rad(1.5), rng)
    yaw = yaw + np.deg2rad(hand.pan_deg) * np.sin(2 * np.pi * at / hand.pan_frames)
    pitch = np.deg2rad(hand.pitch_deg) + sway(at, np.deg2rad(3), rng)
    return look(np.stack([x, y, z], -1), yaw, pitch, sway(at, np.deg2rad(1.5), rng))


def frames_at(step_m: float, tour: ArrayLike) -> int:
    """How many frames a walk around a tour (N, 3) takes, with that step from each to the next."""
    at = np.arange(LENGTH_SAMPLES, dtype=float)
    length_m = _effort(_closed_curve(np.asarray(tour, float), len(at), at).T).sum()
    return 1 + round(float(length_m) / step_m)


def look(
    positions: NDArray[np.float64],
    yaw: NDArray[np.float64],
    pitch: NDArray[np.float64],
    roll: NDArray[np.float64],
) -> NDArray[np.float64]:
    """T_world_camera (N, 4, 4); radians: yaw 0 looks along +x, pitch up, roll about the view."""
    forward = np.stack(
        [np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)], -1
    )
    right = np.stack([np.sin(yaw), -np.cos(yaw), np.zeros_like(yaw)], -1)
    R = np.stack([right, np.cross(forward, right), forward], -1)
    about_view = se3.exp_so3(roll[..., None] * np.array([0.0, 0, 1]))
    return se3.make(R @ about_view, positions)


def trembling(
    at_s: NDArray[np.float64], tremor_rad: float, roll_rad: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """How a hand turns the camera (M, 4, 4) at times (M,): it trembles about each axis, and rolls.

    Below so many radians about each axis; about the view, both add up.
    """
    rates_hz, phases = rng.uniform(*TREMOR_HZ, (2, 3)), rng.uniform(0, 2 * np.pi, (2, 3))
    waves = np.sin(2 * np.pi * rates_hz * at_s[:, None, None] + phases).mean(1)
    rolled = np.sin(2 * np.pi * at_s / rng.uniform(*ROLL_S))
    turns = tremor_rad * waves + roll_rad * rolled[:, None] * np.array([0.0, 0, 1])
    return se3.make(se3.exp_so3(turns), np.zeros(3))


def _closed_curve(
    tour: NDArray[np.float64], frames: int, at: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The columns (C, M) of a smooth closed curve through a tour that takes so many frames."""
    from scipy.interpolate import CubicSpline

    is_yaw = np.arange(tour.shape[1]) == 2
    turns = 2 * np.pi * is_yaw * np.rint((tour[-1, 2] - tour[0, 2]) / (2 * np.pi))
    knots = np.vstack([tour, tour[:1] + turns])
    effort = np.concatenate([[0], np.cumsum(_effort(knots))])
    drift = np.outer(effort / effort[-1], turns)
    periodic = knots - drift
    periodic[-1] = periodic[0]  # but for rounding it is
    spline = CubicSpline(effort, periodic, bc_type="periodic")
    fine = np.linspace(0, effort[-1], 50 * frames)
    curve = spline(fine) + np.outer(fine / effort[-1], turns)
    done = np.concatenate([[0], np.cumsum(_effort(curve))])
    even = np.linspace(0, done[-1], frames)
    laps = np.floor(at / (frames - 1)) * ((at < 0) | (at > frames - 1))
    reached = np.interp(at - laps * (frames - 1), np.arange(frames), even)
    along = np.array([np.interp(reached, done, curve[:, k]) for k in range(len(turns))])
    return np.asarray(along + np.outer(turns, laps))


def _effort(curve: NDArray[np.float64]) -> NDArray[np.float64]:
    steps = np.diff(curve, axis=0)
    return np.maximum(np.hypot(steps[:, 0], steps[:, 1]), np.abs(steps[:, 2]) / STEP_RAD_PER_M)


def sway(at: NDArray[np.float64], size: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """A sum of slow sines (M,) of frames, below ``size``; a period is 20 frames or more."""
    per_frame = rng.uniform(0.005, 0.05, 4)
    phases = rng.uniform(0, 2 * np.pi, 4)
    turns = 2 * np.pi * np.outer(at, per_frame)
    return np.asarray(size * np.sin(turns + phases).mean(1))
