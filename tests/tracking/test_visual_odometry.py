"""The motion that is expected of a camera, and frames with few features or none."""

from pathlib import Path

import numpy as np
import pytest

from vnav.config import Config, FeaturesConfig
from vnav.core import se3
from vnav.core.frame import Features, Frame
from vnav.core.mapping import FrameFeatures, FrameTable, Odometry
from vnav.features import front_end
from vnav.features.lifting import lift
from vnav.io.formats.trajectories import read_tum
from vnav.registration import Sensor
from vnav.tracking.visual_odometry import Motion, VisualOdometry

CONFIG = Config(features=FeaturesConfig(max_features=700))
FRAMES = 6

STEP = se3.exp([0.0, 0.1, 0.0, 0.2, 0.0, 0.0])
TURN = se3.exp([0.0, 0.5, 0.0, 0.1, 0.0, 0.0])


def after_two_frames() -> Motion:
    """0.1 s apart, and the next comes as soon."""
    motion = Motion()
    motion.approach(5.0)
    motion.follow(0, {})
    motion.approach(5.1)
    motion.follow(1, {0: STEP})
    motion.approach(5.2)
    return motion


def test_the_last_step_is_expected_again() -> None:
    motion = after_two_frames()
    np.testing.assert_allclose(motion.predicted(1), STEP, atol=1e-9)
    np.testing.assert_allclose(motion.predicted(0), STEP @ STEP, atol=1e-9)


def test_after_a_gap_a_longer_step_is_expected() -> None:
    motion = after_two_frames()
    motion.approach(5.3)
    farther = motion.predicted(1)
    assert farther is not None
    np.testing.assert_allclose(se3.log_so3(farther[:3, :3]), [0.0, 0.2, 0.0], atol=1e-9)
    np.testing.assert_allclose(farther[:3, 3], 2 * STEP[:3, 3], atol=1e-9)


def test_after_a_long_gap_the_camera_is_not_expected_out_of_the_world() -> None:
    motion = after_two_frames()
    motion.approach(3600.0)
    farther = motion.predicted(1)
    assert farther is not None
    assert np.linalg.norm(farther[:3, 3]) < 4 * np.linalg.norm(STEP[:3, 3])


def test_frames_of_one_time_are_expected_at_one_place() -> None:
    motion = after_two_frames()
    motion.approach(5.1)
    np.testing.assert_allclose(motion.predicted(1), np.eye(4), atol=1e-9)


def test_what_is_known_of_the_next_step_is_expected_instead_until_it_is_followed() -> None:
    motion = after_two_frames()
    motion.expect(TURN)
    np.testing.assert_allclose(motion.predicted(1), TURN)
    np.testing.assert_allclose(motion.predicted(0), STEP @ TURN)
    motion.follow(2, {1: STEP})
    motion.approach(5.3)
    np.testing.assert_allclose(motion.predicted(2), STEP, atol=1e-9)


def test_nothing_is_expected_of_another_track() -> None:
    motion = after_two_frames()
    motion.follow(2, {})
    assert motion.predicted(1) is None
    assert motion.predicted(2) is not None


@pytest.fixture(scope="module")
def truth(tiny_capture: Path) -> np.ndarray:
    return read_tum(tiny_capture / "groundtruth.txt").T_world_camera


def tracked(frames: list[Frame], sensor: Sensor, features_of_4: int) -> Odometry:
    """The frames, one of which has no more than so many features."""
    tracker = VisualOdometry(CONFIG)
    extract = front_end(CONFIG.features).extract
    for row, frame in enumerate(frames):
        features = extract(frame.color)
        if row == 4:
            features = first(features, features_of_4)
        px = features.keypoints_px
        points = lift(px, frame.depth_m, sensor.intrinsics, CONFIG.registration)
        tracker.add(FrameFeatures(row, features, points), frame, sensor)
    rows = np.arange(FRAMES, dtype=np.int32)
    return tracker.result(FrameTable(np.zeros_like(rows), rows, rows / 30.0))


def first(features: Features, count: int) -> Features:
    return Features(
        features.keypoints_px[:count],
        features.descriptors[:count],
        features.scores[:count],
        features.scales_px[:count],
        features.angles_rad[:count],
    )


def squared_errors(result: Odometry, truth: np.ndarray, i: int, j: int) -> list[float]:
    """Of the edges between two rows, by their own information."""
    found = []
    for edge in result.edges:
        if (edge.i, edge.j) == (i, j):
            off = se3.inverse(se3.inverse(truth[i]) @ truth[j]) @ edge.T_i_j
            xi = np.concatenate([se3.log_so3(off[:3, :3]), off[:3, 3]])
            found.append(float(xi @ edge.information @ xi))
    return found


def test_a_frame_without_features_is_held_by_its_pixels(
    frames: list[Frame], sensor: Sensor, truth: np.ndarray
) -> None:
    result = tracked(frames, sensor, features_of_4=0)
    assert result.segment.tolist() == [0] * FRAMES
    (squared,) = squared_errors(result, truth, 3, 4)
    assert squared < 22.5  # 6 degrees of freedom: 99.9 % of right ones are below
    assert 4 not in [k.row for k in result.keyframes]


def test_a_frame_that_few_features_hold_is_held_by_its_pixels_too(
    frames: list[Frame], sensor: Sensor, truth: np.ndarray
) -> None:
    result = tracked(frames, sensor, features_of_4=40)
    errors = squared_errors(result, truth, 3, 4)
    assert len(errors) == 2
    assert max(errors) < 22.5


def test_a_frame_with_many_features_needs_no_other_pixels(
    frames: list[Frame], sensor: Sensor, truth: np.ndarray
) -> None:
    result = tracked(frames, sensor, features_of_4=700)
    assert len(squared_errors(result, truth, 3, 4)) == 1
