"""Frames of a tiny capture that have few features or none."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vnav.config import Config, FeaturesConfig
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.frame import Features, Frame
from vnav.core.mapping import LOST, FrameFeatures, FrameTable, Odometry
from vnav.features import front_end
from vnav.features.lifting import lift
from vnav.io.formats.trajectories import read_tum
from vnav.registration.reduction import reduced
from vnav.tracking.visual_odometry import VisualOdometry

CONFIG = Config(features=FeaturesConfig(max_features=700))
FRAMES = 6


@pytest.fixture(scope="module")
def truth(tiny_capture: Path) -> np.ndarray:
    return read_tum(tiny_capture / "groundtruth.txt").T_world_camera


def tracked(
    frames: list[Frame],
    camera: Intrinsics,
    features_of_4: int = 700,
    *,
    is_4_elsewhere: bool = False,
) -> Odometry:
    """The frames, one of which has no more than so many features, or pixels of another place."""
    odometry = VisualOdometry(CONFIG)
    extract = front_end(CONFIG.features).extract
    for row, frame in enumerate(frames):
        features = extract(frame.color)
        if row == 4:
            features = first(features, features_of_4)
        px = features.keypoints_px
        points = lift(px, frame.depth_m, camera, CONFIG.registration)
        seen = elsewhere(frame) if row == 4 and is_4_elsewhere else frame
        odometry.add(FrameFeatures(row, features, points), seen, reduced(seen))
    rows = np.arange(FRAMES, dtype=np.int32)
    return odometry.result(FrameTable(np.zeros_like(rows), rows, rows / 30.0))


def elsewhere(frame: Frame) -> Frame:
    """What another place may look like, half as far away."""
    return replace(frame, color=frame.color[::-1].copy(), depth_m=frame.depth_m[::-1] / 2)


def first(features: Features, count: int) -> Features:
    return features[np.arange(count)]


def squared_errors(result: Odometry, truth: np.ndarray, i: int, j: int) -> list[float]:
    """Of the edges between two rows, by their own information."""
    found = []
    for edge in result.edges:
        if (edge.i, edge.j) == (i, j):
            off = se3.inverse(se3.inverse(truth[i]) @ truth[j]) @ edge.T_i_j
            xi = np.concatenate([se3.log_so3(off[:3, :3]), off[:3, 3]])
            found.append(float(xi @ edge.information @ xi))
    return found


def test_a_frame_without_features_is_held_by_its_pixels(
    frames: list[Frame], camera: Intrinsics, truth: np.ndarray
) -> None:
    result = tracked(frames, camera, features_of_4=0)
    assert result.segment.tolist() == [0] * FRAMES
    (squared,) = squared_errors(result, truth, 3, 4)
    assert squared < 22.5  # 6 degrees of freedom: 99.9 % of right ones are below
    assert 4 not in [k.row for k in result.keyframes]


def test_a_frame_that_few_features_hold_is_held_by_its_pixels_too(
    frames: list[Frame], camera: Intrinsics, truth: np.ndarray
) -> None:
    result = tracked(frames, camera, features_of_4=40)
    errors = squared_errors(result, truth, 3, 4)
    assert len(errors) == 2
    assert max(errors) < 22.5


def test_a_frame_with_many_features_needs_no_other_pixels(
    frames: list[Frame], camera: Intrinsics, truth: np.ndarray
) -> None:
    result = tracked(frames, camera)
    assert len(squared_errors(result, truth, 3, 4)) == 1


def test_a_frame_whose_pixels_refute_its_motion_is_lost(
    frames: list[Frame], camera: Intrinsics
) -> None:
    result = tracked(frames, camera, is_4_elsewhere=True)
    assert np.flatnonzero(result.segment == LOST).tolist() == [4]
    assert result.reasons[4] == "the images refute its motion"
