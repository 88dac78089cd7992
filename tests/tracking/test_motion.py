"""The motion that is predicted of a camera."""

from collections.abc import Callable

import numpy as np
import pytest

from vnav.core import se3
from vnav.tracking.motion import ConstantVelocity

SLOW = se3.exp([0.0, 0.02, 0.0, 0.07, 0.0, 0.0])
STEP = se3.exp([0.0, 0.1, 0.0, 0.2, 0.0, 0.0])
TURN = se3.exp([0.0, 0.5, 0.0, 0.1, 0.0, 0.0])


def after_two_frames() -> ConstantVelocity:
    """0.1 s apart, and the next comes as soon."""
    motion = ConstantVelocity()
    motion.predict(5.0)
    motion.update(0, {})
    motion.predict(5.1)
    motion.update(1, {0: STEP})
    motion.predict(5.2)
    return motion


def test_the_last_step_is_predicted_again() -> None:
    motion = after_two_frames()
    np.testing.assert_allclose(motion.predicted(1), STEP, atol=1e-9)
    np.testing.assert_allclose(motion.predicted(0), STEP @ STEP, atol=1e-9)


def test_the_likeliest_pose_is_where_the_motion_goes_on() -> None:
    motion = after_two_frames()
    expected = motion.expected[0]
    beside = [expected @ se3.exp([0, 0, 0, 0, off, 0]) for off in (0.0, 0.02, 0.06, 0.55)]
    turned = [expected @ se3.exp([off, 0, 0, 0, 0, 0]) for off in (0.0, 0.03, 0.3)]
    for poses in (beside, turned):
        log_priors = [motion.log_prior(T) for T in poses]
        assert log_priors[0] == 0
        assert sorted(log_priors, reverse=True) == log_priors
        assert log_priors[-1] > -8  # a camera that is pushed is not impossible


def test_after_a_longer_time_a_camera_may_have_changed_its_motion_more() -> None:
    early, late = after_two_frames(), after_two_frames()
    late.predict(5.4)
    off = se3.exp([0, 0, 0, 0.05, 0, 0])
    assert late.log_prior(late.expected[0] @ off) > early.log_prior(early.expected[0] @ off) + 1


def test_before_there_is_a_velocity_no_pose_is_likelier() -> None:
    motion = ConstantVelocity()
    motion.predict(5.0)
    motion.update(0, {})
    motion.predict(5.1)
    assert motion.log_prior(STEP) == 0


def test_after_a_step_that_may_be_mistaken_another_pose_is_as_likely_as_that() -> None:
    """What repeats every 8 cm goes on by a period more, where the step was one more."""
    motion = ConstantVelocity()
    for row, stamp_s in enumerate((5.0, 5.1)):
        motion.predict(stamp_s)
        motion.update(row, {0: STEP} if row else {}, probability=0.8)
    motion.predict(5.2)
    expected = motion.expected[0]
    far = motion.log_prior(expected @ se3.exp([0, 0, 0, -0.75, 0, 0]))
    assert motion.log_prior(expected) == 0
    assert far == pytest.approx(np.log(0.2 / 0.8), abs=0.02)


def test_where_the_last_step_is_likely_mistaken_the_one_before_tells() -> None:
    motion, without = after_two_frames(), after_two_frames()
    motion.update(2, {1: TURN}, probability=0.3)
    for each in (motion, without):
        each.predict(5.3)
    as_before = without.expected[0]
    assert motion.log_prior(as_before) == pytest.approx(0)
    assert motion.log_prior(motion.expected[0]) == 0
    assert motion.log_prior(as_before @ se3.exp([0, 0, 0, 0.5, 0, 0])) < -3


def test_steps_that_are_all_likely_mistaken_tell_nothing_of_the_next() -> None:
    motion = ConstantVelocity()
    for row in range(3):
        motion.predict(5 + row / 10)
        motion.update(row, {row - 1: STEP} if row else {}, probability=0.3)
    motion.predict(5.3)
    assert motion.log_prior(motion.expected[0] @ se3.exp([0, 0, 0, -0.5, 0, 0])) == 0


@pytest.mark.parametrize("probability", [0.3, 1.0])
def test_a_motion_that_no_camera_makes_is_hardly_likely_whatever_is_known(
    probability: float,
) -> None:
    """Shelves that repeat every 1.3 m, seen ten times a second: 13 m/s."""
    motion = ConstantVelocity()
    for row in range(3):
        motion.predict(5 + row / 10)
        motion.update(row, {row - 1: SLOW} if row else {}, probability)
    motion.predict(5.3)
    shelf_on = motion.expected[0] @ se3.exp([0, 0, 0, 1.3, 0, 0])
    about = motion.expected[0] @ se3.exp([0, 1.0, 0, 0, 0, 0])
    assert motion.log_prior(shelf_on) < -9
    assert motion.log_prior(about) < -9


def test_where_stamps_are_too_near_all_motions_are_fast_and_none_is_unlikely_for_it() -> None:
    motion = ConstantVelocity()
    for row in range(3):
        motion.predict(5 + row / 1000)
        motion.update(row, {row - 1: STEP} if row else {})
    motion.predict(5.003)
    assert motion.log_prior(motion.expected[0]) == 0


def test_after_a_gap_a_longer_step_is_predicted() -> None:
    motion = after_two_frames()
    motion.predict(5.3)
    farther = motion.predicted(1)
    assert farther is not None
    np.testing.assert_allclose(se3.log_so3(farther[:3, :3]), [0.0, 0.2, 0.0], atol=1e-9)
    np.testing.assert_allclose(farther[:3, 3], 2 * STEP[:3, 3], atol=1e-9)


def test_after_a_long_gap_the_camera_is_not_predicted_out_of_the_world() -> None:
    motion = after_two_frames()
    motion.predict(3600.0)
    farther = motion.predicted(1)
    assert farther is not None
    assert np.linalg.norm(farther[:3, 3]) < 4 * np.linalg.norm(STEP[:3, 3])


def test_frames_of_one_time_are_predicted_at_one_place() -> None:
    motion = after_two_frames()
    motion.predict(5.1)
    np.testing.assert_allclose(motion.predicted(1), np.eye(4), atol=1e-9)


@pytest.mark.parametrize("take", [ConstantVelocity.replace_prediction, ConstantVelocity.suggest])
def test_a_measured_step_is_predicted_instead_until_the_frame_is_added(
    take: Callable[[ConstantVelocity, np.ndarray], None],
) -> None:
    motion = after_two_frames()
    take(motion, TURN)
    np.testing.assert_allclose(motion.predicted(1), TURN)
    np.testing.assert_allclose(motion.predicted(0), STEP @ TURN)
    motion.update(2, {1: STEP})
    motion.predict(5.3)
    np.testing.assert_allclose(motion.predicted(2), STEP, atol=1e-9)


def test_a_suggested_step_is_expected_beside_the_others_and_is_no_likelier_for_it() -> None:
    motion = after_two_frames()
    before = motion.expected
    log_prior = motion.log_prior(STEP @ TURN)
    motion.suggest(TURN)
    np.testing.assert_allclose(motion.expected, [STEP @ TURN, *before])
    assert motion.log_prior(STEP @ TURN) == log_prior


def test_a_step_that_replaces_the_predicted_one_is_likely() -> None:
    motion = after_two_frames()
    motion.replace_prediction(TURN)
    assert len(motion.expected) == 2
    assert motion.log_prior(STEP @ TURN) == 0


def test_nothing_is_predicted_of_another_track() -> None:
    motion = after_two_frames()
    motion.update(2, {})
    assert motion.predicted(1) is None
    assert motion.predicted(2) is not None


def test_the_next_frame_is_expected_where_the_motion_leads_or_where_the_camera_is() -> None:
    going_on, resting = after_two_frames().expected
    np.testing.assert_allclose(going_on, STEP @ STEP, atol=1e-9)
    np.testing.assert_allclose(resting, STEP, atol=1e-9)


def test_the_twist_is_that_of_the_last_step_and_none_before_there_is_one() -> None:
    assert not ConstantVelocity().twist.any()
    np.testing.assert_allclose(after_two_frames().twist, [0, 1, 0, *(STEP[:3, 3] / 0.1)], atol=1e-9)


def test_poses_that_are_asked_together_are_as_likely_as_one_by_one() -> None:
    motion = after_two_frames()
    poses = np.stack([motion.expected[0], STEP @ TURN, se3.exp([0, 3, 0, 9, 0, 0])])
    one_by_one = [float(motion.log_prior(T)) for T in poses]
    np.testing.assert_allclose(motion.log_prior(poses), one_by_one)
    assert len(set(one_by_one)) == 3
