"""Frames registered by points whose matches are known, whatever their descriptors."""

from dataclasses import replace

import numpy as np

from tests.registration.test_points3d import CAMERA, CONFIG, MOTION, measured, scattered
from vnav.core import se3
from vnav.core.frame import PoseEstimate
from vnav.core.mapping import FrameFeatures
from vnav.features.matching import DescriptorMatcher
from vnav.registration.followed_points import FollowedRegistration

POINTS, FOLLOWED = 200, np.arange(40, 160)  # rows of a's features that are found again in b
OTHER = MOTION @ se3.make(np.eye(3), [0.3, 0, 0])
ALIKE = np.zeros((POINTS, 128), np.uint8)  # descriptors that tell nothing
PAIR = FollowedRegistration(
    CAMERA, CAMERA, CONFIG, DescriptorMatcher(CONFIG), rows=FOLLOWED.astype(np.intp)
)


def views(moving: int = 0) -> tuple[FrameFeatures, FrameFeatures]:
    """A view and the next, in which so many of the points have moved, too."""
    rng = np.random.default_rng(0)
    points_a = scattered(rng, POINTS)
    points_b = se3.transform(se3.inverse(MOTION), points_a[FOLLOWED])
    points_b[:moving] = se3.transform(se3.inverse(OTHER), points_a[FOLLOWED[:moving]])
    a, b = measured(points_a, ALIKE, rng), measured(points_b, ALIKE[FOLLOWED], rng)
    return a, replace(b, row=1)


def motions(a: FrameFeatures, b: FrameFeatures) -> list[PoseEstimate]:
    found = PAIR.hypotheses(a, b, np.random.default_rng(1), np.eye(4))
    assert isinstance(found, list)
    return found


def test_points_tell_the_motion_without_descriptors() -> None:
    a, b = views()
    (estimate,) = motions(a, b)
    assert np.linalg.norm((se3.inverse(MOTION) @ estimate.T_a_b)[:3, 3]) < 0.01
    assert np.array_equal(estimate.inliers[:, 0], FOLLOWED[estimate.inliers[:, 1]])
    assert len(estimate.inliers) > 0.9 * len(FOLLOWED)


def test_points_that_move_by_themselves_are_a_second_motion() -> None:
    a, b = views(moving=50)
    first, second = motions(a, b)
    for estimate, truth in ((first, MOTION), (second, OTHER)):
        assert np.linalg.norm((se3.inverse(truth) @ estimate.T_a_b)[:3, 3]) < 0.02


def test_only_points_near_the_prediction_match() -> None:
    a, b = views(moving=50)
    near = PAIR.match_guided(a, b, MOTION, CONFIG.refine_radius_px)
    assert (near[:, 1] >= 50).mean() > 0.9
    assert len(near) > 0.9 * (len(FOLLOWED) - 50)


def test_a_point_that_is_followed_has_no_twin() -> None:
    assert PAIR.among_twins(*views(), np.random.default_rng(1), MOTION) == []
