"""What every filter over all frames must hold; a new one in FILTERS is tested by being there."""

from dataclasses import replace

import numpy as np
import pytest

from tests.registration.plane_views import CAMERA, Plane, speckle, view
from vnav.config import Config, load
from vnav.config.registries import FILTERS, registered
from vnav.core import se3
from vnav.core.frame import Frame
from vnav.core.mapping import LOST, FrameTable, Odometry
from vnav.errors import CaptureError
from vnav.features import front_end
from vnav.features.description import undescribed
from vnav.registration.reduction import reduced
from vnav.tracking.odometry_builder import OdometryBuilder

STEP_M, STEPS = 0.02, 14
SCENE = (
    Plane(2.0, speckle(1)),
    Plane(1.0, speckle(2), (-0.4, -0.5), (0.2, 0.5)),
    Plane(1.4, speckle(5), (0.35, -0.6), (0.9, 0.3)),
)
TRUTH = se3.make(np.eye(3), np.outer(np.arange(STEPS), [STEP_M, 0, 0]))


@pytest.fixture(scope="module", params=sorted(FILTERS))
def config(request: pytest.FixtureRequest) -> Config:
    quick = ("features.max_features=300", "odometry.keyframe_translation_m=0.1")
    return load(settings=[f"tracking.method={request.param}", "masking.method=none", *quick])


@pytest.fixture(scope="module")
def walk() -> list[Frame]:
    return [view(SCENE, k * STEP_M, seed=k, index=k) for k in range(STEPS)]


def black(frame: Frame) -> Frame:
    color = np.zeros_like(frame.color)
    return Frame(0, frame.index, frame.stamp_s, color, frame.depth_m, CAMERA)


def builder(config: Config) -> OdometryBuilder:
    made: OdometryBuilder = registered(FILTERS, config.tracking.method)(config)
    return made


def tracked(config: Config, frames: list[Frame]) -> tuple[Odometry, list[bool]]:
    made = builder(config)
    is_keyframe = [
        made.add(undescribed(row), frame, reduced(frame)) for row, frame in enumerate(frames)
    ]
    rows = np.arange(len(frames))
    return made.result(FrameTable(0 * rows, rows, rows / 10)), is_keyframe


@pytest.fixture(scope="module")
def whole(config: Config, walk: list[Frame]) -> tuple[Odometry, list[bool]]:
    """The whole walk, tracked, and which frames became keyframes."""
    return tracked(config, walk)


def test_every_frame_has_a_pose_in_the_first_of_its_segment(
    whole: tuple[Odometry, list[bool]],
) -> None:
    odometry, _ = whole
    assert odometry.reasons == ("",) * STEPS
    assert set(odometry.segment) == {0}
    # as in the tests of the filter itself: before planes, a way looks like a turn
    assert odometry.T_segment_camera[:, :3, 3] == pytest.approx(TRUTH[:, :3, 3], abs=0.015)


def test_edges_join_neighbours_and_know_how_well(
    whole: tuple[Odometry, list[bool]],
) -> None:
    odometry, _ = whole
    assert [(e.i, e.j) for e in odometry.edges] == [(k, k + 1) for k in range(STEPS - 1)]
    for e in odometry.edges:
        between = se3.inverse(odometry.T_segment_camera[e.i]) @ odometry.T_segment_camera[e.j]
        off = se3.deviation(se3.inverse(e.T_i_j) @ se3.inverse(TRUTH[e.i]) @ TRUTH[e.j])
        assert np.linalg.eigvalsh(e.information).min() > 0
        # chi-squared of 6: beyond 5 standard deviations once in a million
        assert off @ e.information @ off < 38
        # the motion as it was known then, and between poses as they are in the end: alike
        assert se3.deviation(se3.inverse(between) @ e.T_i_j) == pytest.approx(0, abs=0.01)


def test_keyframes_are_described_and_have_depth(
    config: Config, whole: tuple[Odometry, list[bool]]
) -> None:
    odometry, is_keyframe = whole
    assert odometry.keyframe_rows.tolist() == np.flatnonzero(is_keyframe).tolist()
    assert is_keyframe[0]
    assert 3 <= len(odometry.keyframes) <= 6  # 26 cm, one every 10 cm or where the view changed
    for keyframe in odometry.keyframes:
        assert keyframe.has_depth.sum() > 50
        assert keyframe.features.space == front_end(config.features).space


def test_frames_are_lost_and_found_again(config: Config, walk: list[Frame]) -> None:
    odometry, _ = tracked(config, [*walk[:5], black(walk[5]), *walk[6:]])
    assert [row for row, reason in enumerate(odometry.reasons) if reason] == [5]
    assert odometry.segment[5] == LOST
    assert np.isnan(odometry.T_segment_camera[5]).all()
    assert set(odometry.segment) == {0, LOST}
    assert [(e.i, e.j) for e in odometry.edges if 6 in (e.i, e.j)] == [(4, 6), (6, 7)]


def test_what_is_lost_for_long_begins_anew(config: Config, walk: list[Frame]) -> None:
    """From frame 4 on another place is seen, at 10 Hz."""
    elsewhere = [Plane(1.5, speckle(9))]
    after = [view(elsewhere, k * STEP_M, seed=k, index=k) for k in range(4, 10)]
    impatient = replace(config.tracking, ekf=replace(config.tracking.ekf, max_lost_s=0.35))
    odometry, is_keyframe = tracked(replace(config, tracking=impatient), [*walk[:4], *after])
    assert odometry.segment.tolist() == [0] * 4 + [LOST] * 3 + [1] * 3
    assert [bool(reason) for reason in odometry.reasons] == [False] * 4 + [True] * 3 + [False] * 3
    assert is_keyframe[7]
    assert odometry.T_segment_camera[7] == pytest.approx(np.eye(4))


def test_a_frame_that_cannot_be_read_is_left_out(config: Config, walk: list[Frame]) -> None:
    made = builder(config)
    for row, frame in enumerate(walk[:6]):
        if row == 3:
            made.skip(row, "damaged")
        else:
            made.add(undescribed(row), frame, reduced(frame))
    rows = np.arange(6)
    odometry = made.result(FrameTable(0 * rows, rows, rows / 10))
    assert odometry.reasons == ("", "", "", "damaged", "", "")
    assert odometry.segment.tolist() == [0, 0, 0, LOST, 0, 0]


def test_landmarks_lie_where_things_are(
    whole: tuple[Odometry, list[bool]],
) -> None:
    odometry, _ = whole
    assert len(odometry.landmarks) > 10
    depth = odometry.landmarks[:, 2]
    off = np.min([np.abs(depth - plane.z) for plane in SCENE], 0)
    assert np.median(off) < 0.03  # a camera that is off by 1 cm sees them 1 cm off, depth as much


def test_the_same_frames_give_the_same_odometry(config: Config, walk: list[Frame]) -> None:
    first, second = (tracked(config, walk[:6])[0] for _ in range(2))
    np.testing.assert_array_equal(first.T_segment_camera, second.T_segment_camera)
    for a, b in zip(first.edges, second.edges, strict=True):
        np.testing.assert_array_equal(a.information, b.information)


def test_frames_are_not_written_into(config: Config, walk: list[Frame]) -> None:
    small = [reduced(frame) for frame in walk[:3]]
    made = builder(config)
    for row in range(3):
        made.add(undescribed(row), walk[row], small[row])
    for frame, image in zip(walk, small, strict=False):
        np.testing.assert_array_equal(image.grey, reduced(frame).grey)


def test_frames_that_show_nothing_are_an_error(config: Config, walk: list[Frame]) -> None:
    with pytest.raises(CaptureError, match="found none in 3 frames"):
        tracked(config, [black(frame) for frame in walk[:3]])
