"""The delay of depth, by views of a camera that turns to and fro."""

import numpy as np
import pytest

from tests.masking.panning_camera import RATE_HZ, SIGMA_PER_M2, frame_at, pose_at
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera_motion import velocities
from vnav.core.mapping import FrameTable
from vnav.masking.depth_delay import (
    APART_S,
    MOST_PAIRS,
    NONE,
    STEPS_S,
    DepthDelay,
    TimedFrame,
    depth_delay,
    telling_pairs,
)

SECONDS = 6.0
MARGIN_M, STEP_S = 0.07, STEPS_S[1] - STEPS_S[0]
STAMPS_S = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
POSES = np.array([pose_at(s) for s in STAMPS_S])
ROWS = np.arange(len(STAMPS_S))
TWISTS = velocities(POSES, FrameTable(0 * ROWS, ROWS, STAMPS_S))


def told(delay_s: float | Array, poses: Array = POSES, stamps: Array = 0 * STAMPS_S) -> DepthDelay:
    """Of depth that is late by ``delay_s`` (N,) or one, and by ``stamps`` (N,) says so."""
    late_s = np.broadcast_to(delay_s, len(STAMPS_S))

    def timed(row: int) -> TimedFrame:
        image = frame_at(STAMPS_S[row], late_s[row]).moving(TWISTS[row])
        return TimedFrame(image, poses[row], stamps[row])

    pairs = [(timed(i), timed(j)) for i, j in telling_pairs(TWISTS, STAMPS_S)]
    return depth_delay(pairs, SIGMA_PER_M2, MARGIN_M)


@pytest.mark.parametrize("delay_s", [-0.03, 0.0, 0.02, 0.04])
def test_depth_that_is_early_or_late_fits_best_by_its_delay(delay_s: float) -> None:
    found = told(delay_s)
    assert found.seconds == pytest.approx(delay_s, abs=STEP_S / 2)
    assert not found.stamped


VARYING_S = np.random.default_rng(0).uniform(-0.016, 0.016, len(STAMPS_S))  # half a frame


def test_stamps_of_depth_count_where_images_bear_them_out() -> None:
    found = told(VARYING_S - 0.02, stamps=VARYING_S)
    assert found.seconds == pytest.approx(-0.02, abs=STEP_S / 2)
    assert found.stamped
    assert found.of(0.01) == pytest.approx(found.seconds + 0.01)


def test_stamps_of_depth_that_images_contradict_tell_nothing() -> None:
    assert told(0.0, stamps=VARYING_S) == NONE


def test_poses_that_are_off_at_random_tell_no_delay() -> None:
    off = np.random.default_rng(0).normal(0, np.repeat([0.02, 0.02], 3), (len(POSES), 6))
    assert told(0.0, np.asarray(POSES @ se3.exp(off))) == NONE


def test_no_pairs_tell_no_delay() -> None:
    assert depth_delay([], SIGMA_PER_M2, MARGIN_M) == NONE


def test_pairs_are_of_frames_that_turn_most_differently_and_apart_in_time() -> None:
    pairs = telling_pairs(TWISTS, STAMPS_S)
    first = np.sort(STAMPS_S[[i for i, _ in pairs]])
    assert 0 < len(pairs) <= MOST_PAIRS
    assert (np.diff(first) >= APART_S).all()
    turns = [np.linalg.norm(TWISTS[i, :3] - TWISTS[j, :3]) for i, j in pairs]
    assert turns[0] == max(turns)
    assert turns[0] > 2.0  # rad/s: a pan to one side has 1.6 at most


def test_a_camera_that_rests_has_no_pairs() -> None:
    assert telling_pairs(0 * TWISTS, STAMPS_S) == []


def test_a_frame_whose_twist_nothing_tells_is_in_no_pair() -> None:
    unknown = ROWS % 3 == 0
    pairs = telling_pairs(np.where(unknown[:, None], 0, TWISTS), STAMPS_S)
    assert pairs
    assert not unknown[np.array(pairs)].any()
