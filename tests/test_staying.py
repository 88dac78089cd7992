"""Rendered cameras that stay about one place."""

import numpy as np
import pytest

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.synthetic.path import Hand
from vnav.synthetic.staying import CENTRE_M, MOTIONS, REACH_M, TREMOR_M, TREMOR_RAD, stay

PLACE = np.array([1.0, 2.0, 0.3, 2.5])  # x, y, yaw, and the floor of an upper storey
HAND = Hand(height_m=1.2, pitch_deg=-20.0)
HOME = np.array([1.0, 2.0, 2.5 + 1.2])
AHEAD = np.array([np.cos(PLACE[2]), np.sin(PLACE[2]), 0])
AXES = np.stack([AHEAD, [-AHEAD[1], AHEAD[0], 0], [0, 0, 1]])
RATE_HZ = 30.0
AT_S = np.arange(0, 15, 1 / RATE_HZ)  # once through each axis, and around
FASTEST_M_S, FASTEST_RAD_S = 0.8, 0.8  # of who holds a camera, tremor included


def poses(motion: str) -> Array:
    return stay(motion, PLACE, HAND, np.random.default_rng(0), AT_S)


@pytest.mark.parametrize("motion", MOTIONS)
def test_a_camera_that_stays_moves_as_smoothly_as_a_hand(motion: str) -> None:
    T = poses(motion)
    steps = np.array([se3.deviation(se3.inverse(a) @ b) for a, b in zip(T, T[1:], strict=False)])
    turns_rad, moves_m = np.linalg.norm(steps.reshape(-1, 2, 3), axis=2).T
    assert turns_rad.max() < FASTEST_RAD_S / RATE_HZ
    assert moves_m.max() < FASTEST_M_S / RATE_HZ


@pytest.mark.parametrize("motion", ["static", "rpy"])
def test_only_a_tremor_moves_a_camera_that_keeps_its_place(motion: str) -> None:
    assert np.abs(poses(motion)[:, :3, 3] - HOME).max() < TREMOR_M


@pytest.mark.parametrize("motion", ["static", "xyz"])
def test_only_a_tremor_turns_a_camera_that_keeps_its_direction(motion: str) -> None:
    T = poses(motion)
    turned = [se3.rotation_angle(se3.inverse(T[0]) @ each) for each in T]
    assert max(turned) < 2 * np.sqrt(3) * TREMOR_RAD  # from one end of it to the other


def test_xyz_goes_there_and_back_along_each_axis_in_turn() -> None:
    moved = (poses("xyz") - poses("static"))[:, :3, 3] @ AXES.T
    for axis, turn in enumerate(np.split(moved, 3)):
        assert turn[:, axis].max() == pytest.approx(REACH_M, rel=0.01)
        assert turn[:, axis].min() == pytest.approx(-REACH_M, rel=0.01)
        assert np.abs(np.delete(turn, axis, 1)).max() < 1e-9


def test_a_camera_on_a_halfsphere_looks_at_its_centre() -> None:
    T = poses("halfsphere")
    centre = HOME + CENTRE_M * np.array([1, 0, np.tan(np.deg2rad(HAND.pitch_deg))]) @ AXES
    x, y, z = np.array([se3.transform(se3.inverse(each), centre[None])[0] for each in T]).T
    assert np.ptp(T[:, :3, 3], axis=0).min() > 0.2  # it does move
    assert (np.hypot(x, y) / z).max() < 0.1
