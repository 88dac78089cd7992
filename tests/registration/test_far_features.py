"""Two views of which most features have no depth: they turn with the camera, and have parallax."""

from dataclasses import replace

import numpy as np
import pytest

from tests.registration.test_points3d import CAMERA, CONFIG, MOTION, PAIR, described, measured
from vnav.core import se3
from vnav.core.frame import PoseEstimate, Rejected
from vnav.core.mapping import FrameFeatures
from vnav.registration.far_features import KNOWN, count_without_depth, triangulated

NEAR, FAR = 30, 150
TRIALS = 20
Views = tuple[FrameFeatures, FrameFeatures]


def points_a(rng: np.random.Generator) -> np.ndarray:
    """Near points low in the image, 1 to 2 m away, then far ones above, 4 to 9 m away."""
    low = CAMERA.unproject(rng.uniform([20, 330], [619, 459], (NEAR, 2)), rng.uniform(1, 2, NEAR))
    high = CAMERA.unproject(rng.uniform([60, 60], [560, 330], (FAR, 2)), rng.uniform(4, 9, FAR))
    return np.concatenate([low, high])


def views(rng: np.random.Generator, *T_a_camera: np.ndarray) -> list[FrameFeatures]:
    """What cameras see of the same points, as `measured`; only the near ones have depth."""
    points, descriptors, found = points_a(rng), described(rng, NEAR + FAR), []
    for T in T_a_camera:
        frame = measured(se3.transform(se3.inverse(T), points), descriptors, rng)
        lifted = frame.points_camera.copy()
        lifted[NEAR:] = np.nan
        found.append(replace(frame, points_camera=lifted))
    return found


def near_alone(frame: FrameFeatures) -> FrameFeatures:
    return frame[np.arange(NEAR)]


def estimated(a: FrameFeatures, b: FrameFeatures) -> PoseEstimate:
    found = PAIR.register(a, b, np.random.default_rng(0))
    assert isinstance(found, PoseEstimate), found
    return found


def off(estimate: PoseEstimate) -> np.ndarray:
    """How far a motion is off (6,), rotation first."""
    return np.asarray(se3.deviation(se3.inverse(MOTION) @ estimate.T_a_b))


def by_far(T_a_b: np.ndarray) -> PoseEstimate:
    """A motion that all far features agree on, and no other."""
    rows = np.repeat(np.arange(NEAR, NEAR + FAR)[:, None], 2, 1).astype(np.int32)
    return PoseEstimate(T_a_b, np.eye(6), rows[:0], FAR, far=rows)


def told(a: FrameFeatures, b: FrameFeatures, T_a_b: np.ndarray) -> Views:
    """Both with the parallax of that motion."""
    return triangulated(a, b, by_far(T_a_b), (CAMERA, CAMERA), CONFIG.pixel_sigma_px)


def with_known_depths(a: FrameFeatures, seed: int) -> FrameFeatures:
    """The view of `points_a` of a seed, whose inverse depths parallax has told."""
    w = 1 / points_a(np.random.default_rng(seed))[:, 2]
    return replace(a, triangulated=np.column_stack([w, np.full(len(w), 0.01)]))


def test_features_without_depth_tell_how_the_camera_turned() -> None:
    """They are 150 beside 30 with depth, which are all in one part of the image."""
    errors = np.zeros((2, TRIALS))
    for seed in range(TRIALS):
        a, b = views(np.random.default_rng(seed), np.eye(4), MOTION)
        for k, pair in enumerate(((near_alone(a), near_alone(b)), (a, b))):
            errors[k, seed] = np.linalg.norm(off(estimated(*pair))[:3])
    with_near, with_all = np.sqrt((errors**2).mean(1))
    assert with_all < 0.6 * with_near


def test_the_information_says_how_far_the_motion_is_off() -> None:
    sigmas = np.zeros((TRIALS, 6))
    for seed in range(TRIALS):
        estimate = estimated(*views(np.random.default_rng(seed), np.eye(4), MOTION))
        sigmas[seed] = off(estimate) / np.sqrt(np.diag(np.linalg.inv(estimate.information)))
    assert np.sqrt((sigmas**2).mean()) < 1.5


def test_matches_without_depth_are_told_apart_from_those_with_it() -> None:
    estimate = estimated(*views(np.random.default_rng(1), np.eye(4), MOTION))
    assert (estimate.inliers < NEAR).all()
    assert (estimate.far >= NEAR).all()
    assert len(estimate.inliers) > 0.9 * NEAR
    assert len(estimate.far) > 0.9 * FAR


def test_without_any_depth_there_is_no_scale_and_no_motion() -> None:
    a, b = views(np.random.default_rng(2), np.eye(4), MOTION)
    far = np.arange(NEAR, NEAR + FAR)
    assert isinstance(PAIR.register(a[far], b[far], np.random.default_rng(0), MOTION), Rejected)


def test_a_motion_that_what_has_depth_contradicts_is_rejected() -> None:
    """Far features alone leave it open how much of a motion is a turn."""
    a, b = views(np.random.default_rng(3), np.eye(4), MOTION)
    a = with_known_depths(a, 3)
    apart = np.random.default_rng(0).uniform(1.2, 1.5, (len(a.features), 1))
    elsewhere = replace(a, points_camera=(a.points_camera * apart).astype(np.float32))
    rows = np.repeat(np.arange(len(a.features))[:, None], 2, 1).astype(np.int32)
    assert isinstance(PAIR._refined(MOTION, a, b, rows), PoseEstimate)
    assert isinstance(PAIR._refined(MOTION, elsewhere, b, rows), Rejected)


def test_where_most_features_have_depth_the_others_are_not_asked() -> None:
    a, b = views(np.random.default_rng(4), np.eye(4), MOTION)
    most = np.arange(NEAR + NEAR // 2)
    assert count_without_depth(a, b)
    assert not count_without_depth(a[most], b[most])
    assert not len(estimated(a[most], b[most]).far)


def test_inverse_depth_is_as_exact_as_parallax_tells() -> None:
    """By the true motion, within what the noise of two keypoints explains; 4 % would be 2 sigma."""
    a, b = views(np.random.default_rng(5), np.eye(4), MOTION)
    true_a = 1 / points_a(np.random.default_rng(5))[NEAR:, 2]
    a, _ = told(a, b, MOTION)
    assert a.triangulated is not None
    w, sigma = a.triangulated[NEAR:].T
    assert np.sqrt((((w - true_a) / sigma) ** 2).mean()) == pytest.approx(1, abs=0.25)
    assert (sigma < KNOWN).mean() > 0.9
    assert (a.triangulated[:NEAR, 1] > 1).all()


def test_a_new_frame_takes_over_what_a_wider_baseline_has_told() -> None:
    """From a to b are 0.19 m, from b to c a few millimetres, which tell next to nothing."""
    T_b_c = se3.exp([0.01, 0, 0, 0.004, 0, 0])
    a, b, c = views(np.random.default_rng(6), np.eye(4), MOTION, MOTION @ T_b_c)
    true_c = 1 / se3.transform(se3.inverse(MOTION @ T_b_c), points_a(np.random.default_rng(6)))
    _, alone = told(b, c, T_b_c)
    _, b = told(a, b, MOTION)
    _, c = told(b, c, T_b_c)
    assert alone.triangulated is not None
    assert c.triangulated is not None
    assert (alone.triangulated[NEAR:, 1] > KNOWN).mean() > 0.9
    w, sigma = c.triangulated[NEAR:].T
    assert (sigma < KNOWN).mean() > 0.9
    assert np.sqrt((((w - true_c[NEAR:, 2]) / sigma) ** 2).mean()) < 1.3


@pytest.mark.parametrize("degrees", [0.0, 3.0])
def test_a_known_parallax_holds_the_scale_where_hardly_anything_has_depth(degrees: float) -> None:
    """Ten features with depth are too few by themselves."""
    turn = se3.exp([0, np.deg2rad(degrees), 0, 0, 0, 0])
    a, b, c = views(np.random.default_rng(7), np.eye(4), MOTION, MOTION @ turn @ MOTION)
    few = np.r_[np.arange(10), np.arange(NEAR, NEAR + FAR)]
    T_b_c = turn @ MOTION
    unknown = PAIR.register_near(b[few], c[few], T_b_c)
    _, b = told(a, b, MOTION)
    known = PAIR.register_near(b[few], c[few], T_b_c)
    assert isinstance(unknown, Rejected)
    assert isinstance(known, PoseEstimate), known
    error = se3.deviation(se3.inverse(T_b_c) @ known.T_a_b)
    assert np.linalg.norm(error[3:]) < 0.02


def test_several_motions_are_asked_for_where_nothing_that_has_depth_agrees() -> None:
    """Depth of the other view is nowhere; parallax that was seen before holds the motion."""
    a, b = views(np.random.default_rng(9), np.eye(4), MOTION)
    far = np.arange(NEAR, NEAR + FAR)
    known = with_known_depths(a, 9)[far]
    found = PAIR.hypotheses(known, b[far], np.random.default_rng(0), MOTION)
    assert isinstance(found, list)
    assert not len(found[0].inliers)
    assert np.linalg.norm(off(found[0])[3:]) < 0.02


def test_a_far_feature_is_matched_whatever_the_rows_of_features_with_depth() -> None:
    """Rows of two frames name different features."""
    a, b = views(np.random.default_rng(8), np.eye(4), MOTION)
    turned, known = b[np.arange(NEAR + FAR)[::-1]], with_known_depths(a, 8)
    both = [PAIR.match_guided(known, k, MOTION, CONFIG.search_radius_px) for k in (b, turned)]
    assert len(both[0]) == len(both[1]) > 0.9 * (NEAR + FAR)
