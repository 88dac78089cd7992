"""Frames of the tiny capture tracked once more: which motions change, and to what."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.masking.moving_box import CAMERA, NO_FEATURES, walk
from vnav.config import Config, FeaturesConfig
from vnav.core import se3
from vnav.core.frame import Edge, Frame
from vnav.core.mapping import FrameFeatures
from vnav.features import front_end
from vnav.features.lifting import lift
from vnav.io.formats.trajectories import read_tum
from vnav.masking import PosedView
from vnav.masking.view import still
from vnav.registration.reduction import reduced
from vnav.tracking.frame_masks import FinalFrame, FrameMasks, SeenFrame
from vnav.tracking.pose_choice import TrackedFrame
from vnav.tracking.second_tracking import SecondTracker, SecondTracking

CONFIG = Config(features=FeaturesConfig(max_features=700))
ROWS = 3
ASTRAY = se3.make(np.eye(3), [0.05, 0, 0])  # what following something costs an edge


@pytest.fixture(scope="module")
def poses(tiny_capture: Path) -> np.ndarray:
    return read_tum(tiny_capture / "groundtruth.txt").T_world_camera[:ROWS]


@pytest.fixture(scope="module")
def seen(frames: list[Frame], poses: np.ndarray) -> list[SeenFrame]:
    """The first frames, in which nothing moves, at their true poses."""
    extract = front_end(CONFIG.features).extract
    made = []
    for row, frame in enumerate(frames[:ROWS]):
        features, image = extract(frame.color), reduced(frame)
        points = lift(features.keypoints_px, frame.depth_m, frame.intrinsics, CONFIG.registration)
        tracked = TrackedFrame(FrameFeatures(row, features, points), image, frame.intrinsics)
        view = PosedView(image, poses[row], np.zeros(image.grey.shape, bool))
        made.append(SeenFrame(tracked, view, still(view)))
    return made


def edge(poses: np.ndarray, i: int, j: int) -> Edge:
    return Edge(i, j, se3.inverse(poses[i]) @ poses[j], 1e6 * np.eye(6))


def test_motions_stay_where_no_mask_has_changed(seen: list[SeenFrame], poses: np.ndarray) -> None:
    second = SecondTracker(CONFIG)
    for k in range(ROWS):
        edges = [edge(poses, k - 1, k)] if k else []
        assert not second.track(FinalFrame(seen[k], False), edges).estimates


@pytest.mark.parametrize("changed", [0, 1])
def test_an_edge_that_went_astray_is_mended_where_a_mask_at_either_end_has_changed(
    seen: list[SeenFrame], poses: np.ndarray, changed: int
) -> None:
    second, right = SecondTracker(CONFIG), edge(poses, 0, 1)
    second.track(FinalFrame(seen[0], changed == 0), [])
    wrong = replace(right, T_i_j=right.T_i_j @ ASTRAY)
    astray = replace(seen[1], view=replace(seen[1].view, T_track_camera=poses[1] @ ASTRAY))
    choice = second.track(FinalFrame(astray, changed == 1), [wrong])
    error = se3.inverse(right.T_i_j) @ choice.estimates[0].T_a_b
    sigma_m = np.sqrt(np.diag(np.linalg.inv(choice.estimates[0].information))[3:].max())
    assert np.linalg.norm(error[:3, 3]) < 4 * sigma_m
    assert 4 * sigma_m < 0.02


def test_the_pixels_tell_the_motion_where_a_mask_leaves_hardly_a_feature(
    seen: list[SeenFrame], poses: np.ndarray
) -> None:
    few = [
        replace(s, frame=replace(s.frame, features=s.frame.features[np.arange(5)])) for s in seen
    ]
    second, right = SecondTracker(CONFIG), edge(poses, 0, 1)
    second.track(FinalFrame(seen[0], False), [])
    wrong = replace(right, T_i_j=right.T_i_j @ ASTRAY)
    choice = second.track(FinalFrame(few[1], True), [wrong])
    error = se3.inverse(right.T_i_j) @ choice.estimates[0].T_a_b
    assert np.linalg.norm(error[:3, 3]) < np.linalg.norm(ASTRAY[:3, 3]) / 10


def test_a_frame_of_which_a_mask_leaves_nothing_keeps_its_motions_and_is_passed_over(
    seen: list[SeenFrame], poses: np.ndarray
) -> None:
    second = SecondTracker(CONFIG)
    second.track(FinalFrame(seen[0], False), [])
    hidden = replace(seen[1], moved_s=np.zeros_like(seen[1].moved_s), share=0.5)
    assert not second.track(FinalFrame(hidden, True), [edge(poses, 0, 1)]).estimates
    again = second.track(FinalFrame(seen[2], True), [edge(poses, 1, 2)])
    assert list(again.estimates) == [0]


def test_the_next_frame_follows_from_the_mended_one(
    seen: list[SeenFrame], poses: np.ndarray
) -> None:
    second = SecondTracker(CONFIG)
    second.track(FinalFrame(seen[0], True), [])
    second.track(FinalFrame(seen[1], True), [edge(poses, 0, 1)])
    choice = second.track(FinalFrame(seen[2], False), [edge(poses, 1, 2)])
    assert list(choice.estimates) == [1]


def test_the_second_round_masks_by_the_motions_of_the_first() -> None:
    walked = walk(4.0, lambda t_s: -0.7 + 0.35 * t_s)
    first, ahead = FrameMasks(CONFIG), se3.make(np.eye(3), [0, 0, 0.3])
    second = SecondTracking(CONFIG, first)
    edges = {k: [edge(np.array(walked.poses), k - 1, k)] if k else [] for k in range(40)}
    for row, frame in enumerate(walked.frames):
        nothing = FrameFeatures(row, NO_FEATURES, np.zeros((0, 3)))
        astray = walked.poses[row] @ ahead if row >= 20 else walked.poses[row]
        tracked = TrackedFrame(nothing, frame, CAMERA.scaled(4 * CAMERA.width, 4 * CAMERA.height))
        first.add(first.look(tracked, astray), astray, is_keyframe=True)
    assert not list(second.end(edges))  # no features, no other motions
    by_first, in_the_end = (_iou(masks.moving, walked.box) for masks in (first, second.masks))
    assert by_first < 0.6
    assert in_the_end > 0.8


def _iou(found: Mapping[int, np.ndarray], truth: list[np.ndarray]) -> float:
    masks = [found.get(k, np.zeros_like(box)) for k, box in enumerate(truth)]
    return float(np.logical_and(masks, truth).sum() / np.logical_or(masks, truth).sum())
