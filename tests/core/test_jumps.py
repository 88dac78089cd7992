"""Motions that no camera makes, in tracks at 30 frames a second."""

import numpy as np
import pytest

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.jumps import between_jumps, jumps
from vnav.core.mapping import FrameTable

FRAMES, STEP_S = 100, 1 / 30
PAN_RAD_S, WALK_M_S = 3.0, 1.5  # fast, by hand


def table(stamp_s: Array, captures: int = 1) -> FrameTable:
    """Frames at these times, of one capture after the other."""
    rows = np.arange(len(stamp_s))
    capture = rows * captures // len(rows)
    return FrameTable(capture.astype(np.int32), rows.astype(np.int32), stamp_s)


def track(times: float = 1.0) -> Array:
    """Poses of a camera that pans and walks, so many times as fast; now and then slower."""
    seconds = STEP_S * np.arange(FRAMES)
    turned = times * PAN_RAD_S / 2 * np.sin(2 * seconds)
    walked = np.outer(times * WALK_M_S * seconds, [1, 0, 0])
    return se3.make(se3.exp_so3(np.outer(turned, [0, 1, 0])), walked)


ONE = np.zeros(FRAMES, np.int32)  # part
STAMPS_S = STEP_S * np.arange(FRAMES)
ASIDE = np.array([0, 0, 0, 0.4, 0, 0])  # 12 m/s
TURNED = np.array([0, 0.5, 0, 0, 0, 0])  # 15 rad/s


@pytest.mark.parametrize("jump", [ASIDE, TURNED])
def test_a_jump_is_found_where_it_is(jump: Array) -> None:
    poses = track()
    poses[50:] = poses[50:] @ se3.exp(jump)
    assert jumps(table(STAMPS_S), poses, ONE) == [(49, 50)]


def test_a_fast_camera_does_not_jump() -> None:
    assert jumps(table(STAMPS_S), track(), ONE) == []


def test_wrong_stamps_make_no_jumps() -> None:
    """Every tenth frame of a recording, stamped as if it were all of them."""
    assert jumps(table(STAMPS_S), track(10.0), ONE) == []


def test_stamps_that_lie_near_each_other_make_no_jump() -> None:
    stamps_s = STAMPS_S.copy()
    stamps_s[50] = stamps_s[49] + 1e-4
    assert jumps(table(stamps_s), track(), ONE) == []


def test_after_frames_without_a_pose_a_camera_is_elsewhere() -> None:
    poses = track()
    poses[50:] = poses[50:] @ se3.exp(ASIDE)
    poses[45:50] = np.nan
    assert jumps(table(STAMPS_S), poses, ONE) == []


def test_from_one_capture_to_the_next_nothing_moves() -> None:
    poses = track()
    poses[50:] = poses[50:] @ se3.exp(ASIDE)
    assert jumps(table(STAMPS_S, captures=2), poses, ONE) == []


@pytest.mark.parametrize("posed", [0, 1])
def test_fewer_than_two_poses_make_no_jump(posed: int) -> None:
    poses = track()
    poses[posed:] = np.nan
    assert jumps(table(STAMPS_S), poses, ONE) == []


def test_frames_of_one_time_make_no_jump() -> None:
    assert jumps(table(np.zeros(FRAMES)), track(), ONE) == []


def test_frames_between_two_jumps_are_those_that_jumped() -> None:
    poses = track()
    poses[50:55] = poses[50:55] @ se3.exp(ASIDE)
    assert between_jumps(table(STAMPS_S), poses, ONE).tolist() == [50, 51, 52, 53, 54]


def test_of_two_parts_of_a_track_that_jumps_the_longer_stays() -> None:
    poses = track()
    poses[20:] = poses[20:] @ se3.exp(ASIDE)
    assert between_jumps(table(STAMPS_S), poses, ONE).tolist() == list(range(20))


def test_what_lasts_for_two_seconds_between_jumps_stays() -> None:
    slow_s = 4 * STAMPS_S
    poses = track(0.25)
    poses[80:] = poses[80:] @ se3.exp(4 * ASIDE)
    assert between_jumps(table(slow_s), poses, ONE).tolist() == []


def test_parts_do_not_jump_between_each_other() -> None:
    poses, part = track(), ONE.copy()
    part[50:55] = 1
    poses[50:55] = poses[50:55] @ se3.exp(ASIDE)
    assert between_jumps(table(STAMPS_S), poses, part).tolist() == []


def test_a_track_without_jumps_keeps_all_frames() -> None:
    assert between_jumps(table(STAMPS_S), track(), ONE).tolist() == []
