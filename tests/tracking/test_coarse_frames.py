"""Frames described at half their size between keyframes that are described whole."""

from dataclasses import replace

import numpy as np
import pytest

from tests.registration.plane_views import CAMERA, Plane, speckle, view
from vnav.config import Config, load
from vnav.core import se3
from vnav.core.frame import Frame
from vnav.core.mapping import FrameFeatures, FrameTable, Odometry
from vnav.features.description import FrameDescriber, halved
from vnav.registration.reduction import reduced
from vnav.tracking.feature_tracking import FeatureTracker
from vnav.tracking.pose_choice import ChosenMotions, TrackedFrame
from vnav.tracking.visual_odometry import VisualOdometry

SMALL = ["features.sift.min_half_width_px=160"]
CONFIG = load(settings=SMALL)
SCENE = [Plane(1.5, speckle(1, grain_m=0.03)), Plane(1.0, speckle(2), (-0.4, -0.4), (0.0, 0.2))]
STEP_M, FRAMES = 0.025, 14


@pytest.fixture
def whole(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Rows of the frames that are described whole, in order."""
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
    odometry, describer = VisualOdometry(config), FrameDescriber(config)
    for row, frame in enumerate(frames):
        odometry.add(describer.describe_coarsely(row, frame), frame, reduced(frame))
    rows = np.arange(len(frames), dtype=np.int32)
    return odometry.result(FrameTable(np.zeros_like(rows), rows, rows / 10.0))


def blobs(centres: np.ndarray) -> Frame:
    """Bright spots of 6 px at pixels (N, 2) of a dark image, 1.5 m away."""
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    square = (u - centres[:, 0, None, None]) ** 2 + (v - centres[:, 1, None, None]) ** 2
    grey = 20 + 200 * np.exp(-square / (2 * 6.0**2)).sum(0)
    color = np.repeat(grey.astype(np.uint8)[..., None], 3, 2)
    return Frame(0, 0, 0.0, color, np.full(u.shape, 1.5, np.float32), CAMERA)


def test_features_found_at_half_the_size_lie_where_things_are() -> None:
    rng = np.random.default_rng(0)
    u, v = np.meshgrid(np.arange(50, 300, 55), np.arange(50, 220, 55))
    centres = np.stack([u.ravel(), v.ravel()], 1) + rng.uniform(-1, 1, (u.size, 2))
    few = load(settings=[*SMALL, "tracking.min_points=0"])
    found = FrameDescriber(few).describe_coarsely(0, blobs(centres))
    assert found.is_coarse
    off = found.features.keypoints_px[:, None] - centres
    of_nearest = off[np.arange(len(off)), np.linalg.norm(off, axis=2).argmin(1)]
    on_spots = of_nearest[np.linalg.norm(of_nearest, axis=1) < 3.0]
    assert len(on_spots) >= len(centres)
    # A shift by half a pixel of either image would be 0.5 or 1.0.
    assert np.abs(np.median(on_spots, axis=0)).max() < 0.1


def test_keyframes_alone_are_described_whole(walk: list[Frame], whole: list[int]) -> None:
    result = tracked(walk)
    assert whole == result.keyframe_rows.tolist()
    assert 2 <= len(whole) <= 4
    for keyframe in result.keyframes:
        own = FrameDescriber(CONFIG).describe(keyframe.row, walk[keyframe.row])
        assert not keyframe.is_coarse
        np.testing.assert_array_equal(keyframe.features.descriptors, own.features.descriptors)


def test_motions_by_few_features_are_right_by_their_own_information(walk: list[Frame]) -> None:
    result = tracked(walk)
    assert not any(result.reasons)
    for edge in result.edges:
        true = se3.make(np.eye(3), [(edge.j - edge.i) * STEP_M, 0, 0])
        off = se3.deviation(se3.inverse(true) @ edge.T_i_j)
        assert off @ edge.information @ off < 22.5  # 6 degrees of freedom: 99.9 % of right ones


def test_a_frame_with_too_few_features_at_half_its_size_is_described_whole(
    walk: list[Frame], whole: list[int]
) -> None:
    tracked(walk[:5], load(settings=[*SMALL, "tracking.min_points=100000"]))
    assert whole == [0, 1, 2, 3, 4]


def test_a_frame_that_is_too_small_at_half_its_size_is_described_whole(
    walk: list[Frame], whole: list[int]
) -> None:
    tracked(walk[:3], load(settings=[*SMALL, "features.sift.min_half_width_px=161"]))
    assert whole == [0, 1, 2]


@pytest.mark.parametrize("doubt", ["improbable", "none"])
def test_a_frame_whose_motion_its_few_features_leave_in_doubt_is_described_whole(
    doubt: str, walk: list[Frame], whole: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    track_nearest = FeatureTracker.track_nearest

    def doubting(self: FeatureTracker, current: TrackedFrame) -> ChosenMotions:
        choice = track_nearest(self, current)
        if current.features.row != 3 or not current.features.is_coarse:
            return choice
        found = {i: replace(e, probability=0.4) for i, e in choice.estimates.items()}
        return ChosenMotions(found if doubt == "improbable" else {})

    monkeypatch.setattr(FeatureTracker, "track_nearest", doubting)
    result = tracked(walk[:6])
    assert whole == [0, 3]
    assert not result.segment.any()
    assert min(edge.probability for edge in result.edges if edge.j == 3) > 0.5


def test_of_a_whole_frame_the_coarse_features_are_held_against_those_of_others(
    walk: list[Frame],
) -> None:
    describer = FrameDescriber(CONFIG)
    fine, coarse = describer.describe(0, walk[0]), describer.describe_coarsely(0, walk[0])
    image = reduced(walk[0])
    both = TrackedFrame(fine, image, CAMERA, coarse=coarse)
    assert both.features_for(TrackedFrame(coarse, image, CAMERA)) is coarse
    assert both.features_for(TrackedFrame(fine, image, CAMERA)) is fine


def test_an_image_with_an_odd_row_and_column_is_halved_without_them() -> None:
    color = np.zeros((7, 9, 3), np.uint8)
    color[6], color[:, 8] = 255, 255
    assert halved(color).shape == (3, 4, 3)
    assert not halved(color).any()
