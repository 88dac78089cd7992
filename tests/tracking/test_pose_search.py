"""The pose of a frame among things that repeat, and things that move."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from tests.registration.plane_views import CAMERA, Plane, periodic, plain, speckle, view
from vnav.config import Config, FeaturesConfig
from vnav.core import se3
from vnav.core.frame import Frame, PoseEstimate
from vnav.core.mapping import FrameFeatures
from vnav.features import front_end
from vnav.features.lifting import lift
from vnav.registration.judge import PixelEvidence
from vnav.registration.points3d import PointRegistration
from vnav.registration.reduction import reduced
from vnav.tracking.pose_choice import (
    ChosenMotions,
    LogPrior,
    PoseChoice,
    Target,
    TrackedFrame,
    evenly_likely,
)
from vnav.tracking.pose_search import PoseSearch

CONFIG = Config(features=FeaturesConfig(max_features=500))
PERIOD_M = 0.12
SHELVES = Plane(1.5, periodic(speckle(1, grain_m=0.02), PERIOD_M))
SHELVES_WITH_BOXES = [
    SHELVES,
    Plane(1.2, plain(90), (0.2, -0.5), (0.7, 0.3)),
    Plane(1.3, plain(200), (-0.2, 0.1), (0.15, 0.6)),
]
WALL = Plane(3.0, speckle(2))
PERSON = Plane(1.8, speckle(3, grain_m=0.02), (-0.4, -0.8), (0.4, 0.9))  # 37 % of the view
BARE_ROOM = [
    Plane(3.0, plain(150)),
    Plane(2.6, plain(130), (-2, 0.6), (2, 2)),
    Plane(2.7, plain(170), (-2, -2), (-1.2, 2)),
]
FIRST_M, LAST_M, NOW_M = 0.0, 0.12, 0.18  # where the camera was, and is


def tracked(frame: Frame) -> TrackedFrame:
    features = front_end(CONFIG.features).extract(frame.color)
    points = lift(features.keypoints_px, frame.depth_m, CAMERA, CONFIG.registration)
    return TrackedFrame(FrameFeatures(frame.index, features, points), reduced(frame), CAMERA)


def at(x: float) -> np.ndarray:
    return se3.make(np.eye(3), [x, 0, 0])


def found(
    scenes: list[list[Plane]],
    expected: Sequence[float | np.ndarray],
    log_prior: LogPrior = evenly_likely,
) -> ChosenMotions:
    """The choice for the last of three views."""
    poses = [at(x) if isinstance(x, float) else x for x in expected]
    return PoseSearch(CONFIG).search(*tracked_views(scenes), poses, log_prior)


def tracked_views(scenes: list[list[Plane]]) -> tuple[list[Target], TrackedFrame]:
    """The first two of three views, and the last, of a camera that moves to the right."""
    places = FIRST_M, LAST_M, NOW_M
    first, last, now = (
        tracked(view(s, x, seed=k, index=k))
        for k, (s, x) in enumerate(zip(scenes, places, strict=True))
    )
    return [Target(last, at(LAST_M)), Target(first, at(FIRST_M))], now


def off_m(choice: ChosenMotions) -> list[float]:
    """Of the motions, from the oldest frame on."""
    truth = {0: at(NOW_M - FIRST_M), 1: at(NOW_M - LAST_M)}
    pairs = sorted(choice.estimates.items())
    return [float(np.linalg.norm((se3.inverse(truth[k]) @ e.T_a_b)[:3, 3])) for k, e in pairs]


def test_motions_from_both_frames_agree_on_the_pose_that_is_right() -> None:
    choice = found([[WALL]] * 3, [NOW_M, LAST_M])
    assert max(off_m(choice)) < 0.01
    assert len(choice.estimates) == 2
    assert min(e.probability for e in choice.estimates.values()) > 0.95
    assert not choice.alternatives


@pytest.mark.parametrize("step_m", [0.08, -0.12])
def test_a_person_with_more_matches_is_not_followed(step_m: float) -> None:
    scenes = [[WALL, PERSON.moved(k * step_m)] for k in range(3)]
    choice = found(scenes, [LAST_M + 0.01, LAST_M])
    assert max(off_m(choice)) < 0.02
    assert min(e.probability for e in choice.estimates.values()) > 0.5


def test_among_shelves_that_are_all_the_same_the_pose_that_was_expected_is_among_two() -> None:
    choice = found([[SHELVES]] * 3, [NOW_M + 0.01, NOW_M - PERIOD_M])
    assert choice.estimates.keys() == choice.alternatives.keys()
    apart = [
        np.linalg.norm(choice.estimates[k].T_a_b[:3, 3] - choice.alternatives[k].T_a_b[:3, 3])
        for k in choice.estimates
    ]
    np.testing.assert_allclose(apart, PERIOD_M, atol=0.01)
    assert max(e.probability for e in choice.estimates.values()) < 0.95


@pytest.mark.parametrize("right_m", [NOW_M, NOW_M - PERIOD_M])
def test_among_shelves_that_are_all_the_same_the_likelier_motion_is_taken(right_m: float) -> None:
    scenes, expected = [[SHELVES]] * 3, [NOW_M + 0.01, NOW_M - PERIOD_M]
    choice = found(scenes, expected, lambda T: -8 * abs(T[:, 0, 3] - right_m) / PERIOD_M)
    np.testing.assert_allclose(off_m(choice), NOW_M - right_m, atol=0.01)
    assert choice.probability > 0.9


def test_what_pixels_tell_clearly_no_prior_overrules() -> None:
    choice = found([[WALL]] * 3, [LAST_M, NOW_M], lambda T: -4 * abs(T[:, 0, 3] - LAST_M) / 0.06)
    assert max(off_m(choice)) < 0.01
    assert choice.probability > 0.95


def test_where_matches_lead_to_other_periods_alone_pixels_tell_the_pose_beside_the_expected_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A pan that ends leaves the expected pose 10 px off, which are half a period of 21 px."""

    def elsewhere(
        pair: PointRegistration, a: FrameFeatures, b: FrameFeatures, *_: object
    ) -> list[PoseEstimate]:
        near = [pair.register_near(a, b, at(moved_m - k * PERIOD_M)) for k in (1, 2)]
        return [found for found in near if isinstance(found, PoseEstimate)]

    moved_m, expected_m = 4 * PERIOD_M, 4 * PERIOD_M + 0.055
    monkeypatch.setattr(PointRegistration, "hypotheses", elsewhere)
    monkeypatch.setattr(PointRegistration, "among_twins", lambda *_: [])
    before, now = (
        tracked(view(SHELVES_WITH_BOXES, x, seed=k, index=k)) for k, x in enumerate((0.0, moved_m))
    )
    choice = PoseSearch(CONFIG).search(
        [Target(before, at(0))],
        now,
        [at(expected_m)],
        lambda T: -np.log1p(((T[:, 0, 3] - expected_m) / 0.03) ** 2),
    )
    (estimate,) = choice.estimates.values()
    np.testing.assert_allclose(estimate.T_a_b, at(moved_m), atol=0.005)
    assert estimate.probability > 0.95


def test_poses_that_unknown_delays_set_apart_share_their_probability() -> None:
    (at_rest,), (moving,) = (weighed(v, apart_m=0.006).estimates.values() for v in (0.0, 1.0))
    assert at_rest.probability < 0.9
    assert moving.probability > 0.99


def test_a_pose_that_is_farther_away_than_delays_explain_lends_no_probability() -> None:
    (estimate,) = weighed(1.0, apart_m=PERIOD_M).estimates.values()
    assert estimate.probability < 0.5


def weighed(speed: float, apart_m: float) -> ChosenMotions:
    """The choice between two poses that are so far from the right one, to the left and right."""
    frames = [tracked(view([WALL], x, seed=k, index=k)) for k, x in enumerate((0.0, 0.1, 0.2))]
    twist = np.array([0, 0, 0, speed, 0, 0])
    moving = [replace(f, image=f.image.moving(twist)) for f in frames]
    targets = [Target(moving[1], at(0.1)), Target(moving[0], at(0.0))]
    choice = PoseChoice(targets, moving[2].image, CONFIG.registration)
    inliers = np.zeros((100, 2), np.int32)
    for target, x in zip(targets, (0.1 - apart_m, 0.2 + apart_m), strict=True):
        choice.add(target, [PoseEstimate(at(x), np.eye(6), inliers, 100)])
    choice.judge()
    return choice.result()


def test_motions_from_the_newest_frame_are_told_with_what_its_pixels_say_of_them() -> None:
    """That to the best pose first; shelves that are all the same leave a period beside open."""
    choice = found([[SHELVES]] * 3, [NOW_M + 0.01, NOW_M - PERIOD_M])
    rivals = choice.rivals
    assert rivals is not None
    assert rivals.target == max(choice.estimates)
    first, *others = rivals.estimates
    np.testing.assert_allclose(first.T_a_b, choice.estimates[rivals.target].T_a_b)
    apart_m = [np.linalg.norm(e.T_a_b[:3, 3] - first.T_a_b[:3, 3]) for e in others]
    assert min(abs(m - PERIOD_M) for m in apart_m) < 0.01
    assert rivals.log_odds[0] == 0


def test_a_rival_is_no_likelier_than_all_targets_say(monkeypatch: pytest.MonkeyPatch) -> None:
    """The newest prefers it by two standard deviations, the one before refutes it by five."""

    def says(_choice: PoseChoice, target: Target) -> PixelEvidence:
        z = -2.0 if target.row == 1 else 5.0
        favour = np.array([[0, z, 9], [-z, 0, 9], [-9, -9, 0]])
        return PixelEvidence(favour, np.ones((3, 3)), np.zeros(2))

    monkeypatch.setattr(PoseChoice, "_judged", says)
    frames = [tracked(view([WALL], x, seed=k, index=k)) for k, x in enumerate((0.0, 0.1, 0.2))]
    targets = [Target(frames[1], at(0.1)), Target(frames[0], at(0.0))]
    choice = PoseChoice(targets, frames[2].image, CONFIG.registration)
    inliers = np.zeros((100, 2), np.int32)
    for target, x in zip(targets, (0.1, 0.2), strict=True):
        both = [PoseEstimate(at(x + aside), np.eye(6), inliers, 100) for aside in (0.0, PERIOD_M)]
        choice.add(target, both)
    choice.judge()
    rivals = choice.result().rivals
    assert rivals is not None
    assert rivals.log_odds[1] < -3


def test_what_pixels_clearly_refute_is_no_rival() -> None:
    rivals = found([[WALL]] * 3, [NOW_M + 0.01, NOW_M - PERIOD_M]).rivals
    assert rivals is not None
    assert len(rivals.estimates) == 1


def test_what_poses_share_is_at_most_one_in_spite_of_rounding(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rounded = np.array([0.5, 0.5 + 2.0**-52])
    monkeypatch.setattr(PixelEvidence, "posterior", lambda _evidence, _prior: rounded)
    found = weighed(1.0, apart_m=0.006).estimates.values()
    assert [estimate.probability for estimate in found] == [1.0]


@pytest.mark.parametrize("step_m", [0.06, 0.1, -0.1])
def test_a_person_is_not_believed_where_a_room_without_features_shows_another_motion(
    step_m: float,
) -> None:
    follows = se3.make(np.eye(3), [NOW_M, 0, -step_m])
    scenes = [[*BARE_ROOM, replace(PERSON, z=PERSON.z + z)] for z in (0.0, 0.0, step_m)]
    choice = found(scenes, [follows, at(LAST_M)])
    assert max(off_m(choice)) > 0.05  # no other motion has features
    assert choice.probability < 0.05


def test_where_features_tell_no_motion_all_pixels_tell_it_near_one_that_is_expected() -> None:
    frames = tracked_views([[WALL]] * 3)
    goes_on = at(NOW_M + 0.02)
    choice = PoseSearch(CONFIG).by_pixels(*frames, ChosenMotions(), [goes_on, at(LAST_M)])
    assert max(off_m(choice)) < 0.005
    assert choice.probability > 0.95


def test_a_motion_by_features_stays_where_the_pixels_tell_the_same() -> None:
    frames = tracked_views([[WALL]] * 3)
    by_features = PoseSearch(CONFIG).search(*frames, [at(LAST_M)])
    choice = PoseSearch(CONFIG).by_pixels(*frames, by_features, [at(LAST_M)])
    assert {row: e.agreeing for row, e in choice.estimates.items()} == {
        row: e.agreeing for row, e in by_features.estimates.items()
    }
    assert choice.probability > 0.95


def test_all_pixels_leave_a_rival_by_features_where_it_is() -> None:
    frames, near = tracked_views([[SHELVES]] * 3), at(NOW_M + 0.01)
    by_features = PoseSearch(CONFIG).search(*frames, [near, at(NOW_M - PERIOD_M)])
    choice = PoseSearch(CONFIG).by_pixels(*frames, by_features, [near])
    assert choice.alternatives.keys() == by_features.alternatives.keys()
    assert choice.probability < 0.95
