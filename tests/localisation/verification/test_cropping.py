"""Whether a photo was cropped, by where its principal point was found."""

import dataclasses

import numpy as np
import pytest

from vnav.core.camera import CameraPrior, Intrinsics
from vnav.localisation.hypotheses.pose_refinement import RefinedPose
from vnav.localisation.verification.cropping import CROPPED, SURE, log_odds_of_cropped
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
