"""Cameras that stay about one place, as those of TUM's recordings of people do.

Source: Sturm et al. 2012, "A benchmark for the evaluation of RGB-D SLAM systems": the sequences
static, xyz, rpy and halfsphere of sitting and of walking people.
"""

from collections.abc import Callable

import numpy as np

from vnav.core.arrays import Array
from vnav.synthetic.path import Hand, look, sway

SWAYS_PER_S = 10.0  # frames of `sway`: no period is shorter than 2 s
TREMOR_M, TREMOR_RAD = 0.01, np.deg2rad(0.6)  # at most
AXIS_S = 5.0  # there and back along one axis, or about it
REACH_M, TURN_RAD = 0.28, 0.45  # to either side; at most 0.35 m/s, 32 degrees a second
CENTRE_M = 2.2  # ahead: of the sphere that the camera moves on
AROUND_RAD, AROUND_S, RISE_M, RISE_S = 0.5, 15.0, 0.25, 6.0


def stay(motion: str, place: Array, hand: Hand, rng: np.random.Generator, at_s: Array) -> Array:
    """Poses T_world_camera (M, 4, 4) at times (M,), about a place: x, y, yaw, and the floor's z.

    ``motion``: one of `MOTIONS`.
    """
    x, y, yaw, *floor = place.tolist()
    moved, turned = MOTIONS[motion](at_s)
    ahead = np.array([np.cos(yaw), np.sin(yaw), 0])
    axes = np.stack([ahead, [-ahead[1], ahead[0], 0], [0, 0, 1]])
    tremor = [sway(SWAYS_PER_S * at_s, size, rng) for size in [TREMOR_M] * 3 + [TREMOR_RAD] * 3]
    home = np.array([x, y, sum(floor) + hand.height_m])
    level = np.array([yaw, np.deg2rad(hand.pitch_deg), 0])
    yaws, pitches, rolls = (level + turned + np.stack(tremor[3:], -1)).T
    return look(home + moved @ axes + np.stack(tremor[:3], -1), yaws, pitches, rolls)


def _static(at_s: Array) -> tuple[Array, Array]:
    none = np.zeros((len(at_s), 3))
    return none, none


def _xyz(at_s: Array) -> tuple[Array, Array]:
    each = _in_turn(at_s)
    return REACH_M * each, 0 * each


def _rpy(at_s: Array) -> tuple[Array, Array]:
    each = _in_turn(at_s)
    return 0 * each, TURN_RAD * each


def _halfsphere(at_s: Array) -> tuple[Array, Array]:
    """Around a point ahead, up and down, looking at it."""
    around = AROUND_RAD * np.sin(2 * np.pi * at_s / AROUND_S)
    up_m = RISE_M * np.sin(2 * np.pi * at_s / RISE_S)
    none = np.zeros(len(at_s))
    moved = np.stack([CENTRE_M * (1 - np.cos(around)), CENTRE_M * np.sin(around), up_m], -1)
    return moved, np.stack([-around, -np.arctan2(up_m, CENTRE_M), none], -1)


def _in_turn(at_s: Array) -> Array:
    """From -1 to 1 (M, 3): along the first axis, then the second, then the third, and again."""
    axis = (at_s // AXIS_S).astype(int) % 3
    return np.asarray(np.eye(3)[axis] * np.sin(2 * np.pi * at_s / AXIS_S)[:, None])


MOTIONS: dict[str, Callable[[Array], tuple[Array, Array]]] = {
    "static": _static,
    "xyz": _xyz,
    "rpy": _rpy,
    "halfsphere": _halfsphere,
}
"""By name: how far ahead, to the left and up (M, 3), and how much yaw, pitch and roll (M, 3)."""
