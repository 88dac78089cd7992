"""Frames of a tiny capture followed by all their pixels."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from vnav.config import Config
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.frame import Frame
from vnav.io.formats.trajectories import read_tum
from vnav.tracking.dense_tracking import DenseTracker

CONFIG = Config()


@pytest.fixture(scope="module")
def motions(tiny_capture: Path) -> list[np.ndarray]:
    T = read_tum(tiny_capture / "groundtruth.txt").T_world_camera
    return [se3.inverse(T[k]) @ T[k + 1] for k in range(5)]


def seen(frames: list[Frame], most: int = 30) -> DenseTracker:
    """A tracker that features have told the frames' motions so far."""
    settings = dataclasses.replace(CONFIG.odometry, max_degenerate_frames=most)
    tracker = DenseTracker(dataclasses.replace(CONFIG, odometry=settings))
    for row, frame in enumerate(frames):
        tracker.remember(row, frame, degenerate=False)
    return tracker


def test_a_frame_is_followed_from_the_last(
    frames: list[Frame], motions: list[np.ndarray], camera: Intrinsics
) -> None:
    found = seen(frames[:3]).track(frames[3], camera, motions[1])
    assert found.keys() == {2}
    off = se3.inverse(motions[2]) @ found[2].T_a_b
    xi = np.concatenate([se3.log_so3(off[:3, :3]), off[:3, 3]])
    # By its own information: 6 degrees of freedom, 99.9 % are below 22.5.
    assert xi @ found[2].information @ xi < 22.5


def test_after_a_gap_in_time_nothing_is_predicted(
    frames: list[Frame], motions: list[np.ndarray], camera: Intrinsics
) -> None:
    late = dataclasses.replace(frames[3], stamp_s=frames[2].stamp_s + 3.0)
    assert seen(frames[:3]).track(late, camera, motions[1]) == {}


def test_no_more_frames_in_a_row_are_followed_than_allowed(
    frames: list[Frame], motions: list[np.ndarray], camera: Intrinsics
) -> None:
    tracker = seen(frames[:3], most=1)
    assert tracker.track(frames[3], camera, motions[1])
    tracker.remember(3, frames[3], degenerate=True)
    assert tracker.is_degenerate
    assert tracker.track(frames[4], camera, motions[2]) == {}


def test_without_a_prediction_nothing_is_followed(frames: list[Frame], camera: Intrinsics) -> None:
    assert seen(frames[:3]).track(frames[3], camera, None) == {}
    assert DenseTracker(CONFIG).last_row is None
