"""Frames that show the points of an earlier one, found by Lucas-Kanade."""

from dataclasses import replace

import numpy as np
import pytest

from tests.registration.plane_views import Plane, speckle, view
from vnav.config import Config, load
from vnav.core import se3
from vnav.core.frame import Frame
from vnav.core.mapping import FrameFeatures, FrameTable, Odometry
from vnav.features.description import FrameDescriber, undescribed
from vnav.registration.reduction import reduced
from vnav.tracking.feature_tracking import FeatureTracker
from vnav.tracking.masked_tracking import MaskedTracker
from vnav.tracking.pose_choice import ChosenMotions, TrackedFrame
from vnav.tracking.visual_odometry import VisualOdometry

CONFIG = load(settings=["tracking.method=klt", "features.max_features=500"])
SCENE = [Plane(1.5, speckle(1, grain_m=0.03)), Plane(1.0, speckle(2), (-0.4, -0.4), (0.0, 0.2))]
STEP_M, FRAMES = 0.025, 14


@pytest.fixture
def described(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Rows of the frames that are described, in order."""
    rows: list[int] = []
    describe = FrameDescriber.describe

    def noted(self: FrameDescriber, row: int, frame: Frame) -> FrameFeatures:
        rows.append(row)
        return describe(self, row, frame)

    monkeypatch.setattr(FrameDescriber, "describe", noted)
    return rows


@pytest.fixture(scope="module")
def walk() -> list[Frame]:
    """A camera that goes 32 cm to the right along a wall."""
    return [view(SCENE, k * STEP_M, seed=k, index=k) for k in range(FRAMES)]


def tracked(frames: list[Frame], config: Config = CONFIG) -> Odometry:
    odometry = VisualOdometry(config)
    describer = FrameDescriber(config)
    for row, frame in enumerate(frames):
        is_described = config.tracking.method == "descriptors"
        features = describer.describe(row, frame) if is_described else undescribed(row)
        odometry.add(features, frame, reduced(frame))
    rows = np.arange(len(frames), dtype=np.int32)
    return odometry.result(FrameTable(np.zeros_like(rows), rows, rows / 10.0))


def test_keyframes_alone_are_described_and_keep_their_own_features(
    walk: list[Frame], described: list[int]
) -> None:
    result = tracked(walk)
    assert described == result.keyframe_rows.tolist()
    assert len(described) == 2
    for keyframe in result.keyframes:
        own = FrameDescriber(CONFIG).describe(keyframe.row, walk[keyframe.row])
        np.testing.assert_array_equal(keyframe.features.keypoints_px, own.features.keypoints_px)
        np.testing.assert_array_equal(keyframe.features.descriptors, own.features.descriptors)


def test_the_motions_of_followed_frames_are_right_by_their_own_information(
    walk: list[Frame],
) -> None:
    result = tracked(walk)
    assert not any(result.reasons)
    for edge in result.edges:
        true = se3.make(np.eye(3), [(edge.j - edge.i) * STEP_M, 0, 0])
        off = se3.deviation(se3.inverse(true) @ edge.T_i_j)
        assert off @ edge.information @ off < 22.5  # 6 degrees of freedom: 99.9 % of right ones


def test_where_too_few_points_are_found_it_is_the_odometry_of_described_frames(
    walk: list[Frame], described: list[int]
) -> None:
    few = replace(CONFIG, tracking=replace(CONFIG.tracking, min_points=100_000))
    result = tracked(walk[:5], few)
    assert described == [0, 1, 2, 3, 4]
    plain = tracked(walk[:5], load(settings=["features.max_features=500"]))
    np.testing.assert_array_equal(result.T_segment_camera, plain.T_segment_camera)
    assert [(e.i, e.j) for e in result.edges] == [(e.i, e.j) for e in plain.edges]


def test_a_frame_that_shows_less_than_half_of_the_points_becomes_a_keyframe() -> None:
    settings = ["odometry.keyframe_translation_m=10", "tracking.min_points=10"]
    far = load(settings=["tracking.method=klt", "features.max_features=500", *settings])
    frames = [view(SCENE, k * 0.1, seed=k, index=k) for k in range(12)]
    first, second = tracked(frames, far).keyframe_rows[:2].tolist()
    # Of a view 1.83 m wide half is seen after 0.91 m; some points are lost before.
    assert first == 0
    assert 5 <= second <= 10


def test_a_frame_that_shares_no_view_but_with_its_predecessor_is_tracked(
    described: list[int],
) -> None:
    settings = ["odometry.keyframe_translation_m=10", "tracking.min_points=10"]
    settings.append("odometry.keyframe_min_inlier_share=0")
    far = load(settings=["tracking.method=klt", "features.max_features=500", *settings])
    # A view is 1.83 m wide: the last shares nothing with the first, and 40 % with the one before.
    places = [*np.arange(0, 0.95, 0.1), 2.0]
    frames = [view(SCENE, x, seed=k, index=k) for k, x in enumerate(places)]
    result = tracked(frames, far)
    assert not result.segment.any()
    assert described == [0, 10, 9]
    off = result.T_segment_camera[:, :3, 3] - np.outer(places, [1, 0, 0])
    assert np.linalg.norm(off, axis=1).max() < 0.05  # not another period, nor a step left out


def test_a_frame_whose_motion_its_points_leave_in_doubt_is_described(
    walk: list[Frame], described: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    track_nearest = FeatureTracker.track_nearest

    def doubting(self: FeatureTracker, current: TrackedFrame) -> ChosenMotions:
        choice = track_nearest(self, current)
        if current.features.row != 3 or not current.is_followed:
            return choice
        return ChosenMotions({i: replace(e, probability=0.4) for i, e in choice.estimates.items()})

    monkeypatch.setattr(FeatureTracker, "track_nearest", doubting)
    result = tracked(walk[:6])
    assert described == [0, 3]
    assert min(edge.probability for edge in result.edges if edge.j == 3) > 0.5


def test_a_frame_whose_motion_what_stands_still_leaves_in_doubt_is_described(
    walk: list[Frame], described: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    track = MaskedTracker.track

    def doubting(
        self: MaskedTracker, current: TrackedFrame, choice: ChosenMotions
    ) -> tuple[TrackedFrame, ChosenMotions]:
        static, found = track(self, current, choice)
        if current.features.row != 3 or not current.is_followed:
            return static, found
        doubted = {i: replace(e, probability=0.4) for i, e in found.estimates.items()}
        return static, ChosenMotions(doubted)

    monkeypatch.setattr(MaskedTracker, "track", doubting)
    result = tracked(walk[:6])
    assert described == [0, 3]
    assert min(edge.probability for edge in result.edges if edge.j == 3) > 0.5


def test_after_a_dark_frame_the_next_is_described(walk: list[Frame], described: list[int]) -> None:
    dark = replace(walk[3], color=np.zeros_like(walk[3].color), depth_m=walk[3].depth_m * 0)
    result = tracked([*walk[:3], dark, *walk[4:8]])
    assert [bool(reason) for reason in result.reasons] == [row == 3 for row in range(8)]
    assert described == [0, 3, 4]
