"""Whether a photo was cropped, by where its principal point was found."""

import dataclasses

import numpy as np
import pytest

from vnav.core import se3
from vnav.core.camera import CameraPrior, Intrinsics
from vnav.localisation.hypotheses.pose_refinement import RefinedPose
from vnav.localisation.verification.cropping import (
    CROPPED,
    SURE,
    covariance_of_either,
    log_odds_of_cropped,
)
from vnav.localisation.view import View

CAMERA = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
ROUGHLY = CameraPrior(CAMERA, np.inf, 0.01)


def found(right_px: float, sigma_px: float) -> RefinedPose:
    """A pose whose principal point is so far from the centre, with its standard deviation."""
    camera = dataclasses.replace(CAMERA, cx=CAMERA.cx + right_px)
    covariance = 1e-6 * np.eye(9)
    covariance[7:, 7:] = (sigma_px / 640) ** 2 * np.eye(2)
    return RefinedPose(View(np.eye(4), camera), covariance)


def test_a_photo_whose_principal_point_is_near_the_centre_is_whole() -> None:
    assert log_odds_of_cropped(found(5, 5), ROUGHLY) < -5


def test_a_photo_whose_principal_point_is_far_off_was_cropped() -> None:
    """As surely as may be: what else speaks for a pose may still decide."""
    assert log_odds_of_cropped(found(150, 5), ROUGHLY) == SURE


def test_the_farther_off_the_likelier_it_was_cropped() -> None:
    odds = [log_odds_of_cropped(found(px, 5), ROUGHLY) for px in (0, 10, 20, 30, 40)]
    assert odds == sorted(odds)


def test_a_principal_point_that_matches_leave_open_tells_nothing() -> None:
    """But for the prior: where it may be anywhere by its matches, off the centre is no news."""
    odds = log_odds_of_cropped(found(0, 6400), ROUGHLY)
    assert odds == pytest.approx(np.log(CROPPED / (1 - CROPPED)), abs=0.01)


def test_a_pose_is_as_uncertain_as_another_is_likely_and_far() -> None:
    """One that is right with a probability of a fifth, 0.5 m to the right: 0.2 * 0.25 m2."""
    pose = found(0, 5)
    other = RefinedPose(pose.view.moved(np.array([0, 0, 0, 0.5, 0, 0])), 4 * pose.covariance)
    spread = np.zeros((9, 9))
    spread[3, 3] = 0.2 * 0.25
    expected = (0.8 * pose.covariance + 0.2 * other.covariance)[:7, :7] + spread[:7, :7]
    mixed = covariance_of_either(RefinedPose(pose.view, pose.covariance[:7, :7]), other, 0.2)
    np.testing.assert_allclose(mixed, expected, atol=1e-12)


def test_a_pose_that_is_surely_right_stays_as_certain_as_it_was() -> None:
    pose = found(0, 5)
    far = RefinedPose(View(se3.exp([0, 1, 0, 3, 0, 0]), CAMERA), pose.covariance)
    certain = RefinedPose(pose.view, pose.covariance[:6, :6])
    np.testing.assert_allclose(covariance_of_either(certain, far, 0.0), certain.covariance)
