"""Velocities of a camera that moves by one twist all the time."""

import numpy as np

from vnav.core import se3
from vnav.core.camera_motion import velocities
from vnav.core.mapping import FrameTable

TWIST = np.array([0.3, -0.8, 0.2, 0.5, 0.1, -0.4])
COUNT, STEP_S = 9, 1 / 30


def frames(stamps_s: np.ndarray, capture: np.ndarray | None = None) -> FrameTable:
    rows = np.arange(len(stamps_s))
    return FrameTable(0 * rows if capture is None else capture, rows, stamps_s)


def poses(stamps_s: np.ndarray) -> np.ndarray:
    return se3.exp(stamps_s[:, None] * TWIST)


STAMPS_S = STEP_S * np.arange(COUNT)


def test_the_twist_is_found_between_frames_and_at_the_ends() -> None:
    found = velocities(poses(STAMPS_S), frames(STAMPS_S))
    np.testing.assert_allclose(found[1:-1], np.tile(TWIST, (COUNT - 2, 1)), atol=1e-3)
    # One step alone errs by half of its turn, 1.4 % of a radian.
    np.testing.assert_allclose(found[[0, -1]], np.tile(TWIST, (2, 1)), atol=0.02)


def test_the_twist_is_found_at_three_frames_a_second() -> None:
    stamps_s = np.arange(COUNT) / 3
    found = velocities(poses(stamps_s), frames(stamps_s))
    # Two steps err by a sixth of the square of a step's turn, 0.29 rad.
    np.testing.assert_allclose(found[1:-1], np.tile(TWIST, (COUNT - 2, 1)), atol=0.01)


def test_a_frame_that_is_lost_tells_nothing_of_its_neighbours() -> None:
    T = poses(STAMPS_S)
    T[4] = np.nan
    found = velocities(T, frames(STAMPS_S))
    assert np.isfinite(found).all()
    np.testing.assert_array_equal(found[4], np.zeros(6))
    np.testing.assert_allclose(found[[3, 5]], np.tile(TWIST, (2, 1)), atol=0.02)


def test_over_a_gap_nothing_is_known() -> None:
    far_apart_s = np.array([0.0, 0.5, 1.0])
    found = velocities(poses(far_apart_s), frames(far_apart_s))
    np.testing.assert_array_equal(found, np.zeros((3, 6)))


def test_frames_of_two_captures_are_no_neighbours() -> None:
    found = velocities(poses(STAMPS_S[:2]), frames(STAMPS_S[:2], np.array([0, 1])))
    np.testing.assert_array_equal(found, np.zeros((2, 6)))


def test_one_frame_stands() -> None:
    np.testing.assert_array_equal(
        velocities(np.eye(4)[None], frames(np.zeros(1))), np.zeros((1, 6))
    )
