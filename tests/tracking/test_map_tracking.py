"""Frames of a tiny capture, held against its first keyframe by patches."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from vnav.config import Config
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.frame import Edge, Frame
from vnav.core.mapping import FrameFeatures
from vnav.features import front_end
from vnav.features.lifting import lift
from vnav.io.formats.trajectories import read_tum
from vnav.tracking.map_tracking import MapTracker
from vnav.tracking.motion import ConstantVelocity

CONFIG = Config()
OFF_BY = se3.exp([0.002, -0.003, 0.001, 0.002, 0.003, -0.002])  # some 2 pixels


@pytest.fixture(scope="module")
def truth(tiny_capture: Path) -> np.ndarray:
    return read_tum(tiny_capture / "groundtruth.txt").T_world_camera


@pytest.fixture(scope="module")
def described(frames: list[Frame], camera: Intrinsics) -> FrameFeatures:
    features = front_end(CONFIG.features).extract(frames[0].color)
    points = lift(features.keypoints_px, frames[0].depth_m, camera, CONFIG.registration)
    return FrameFeatures(0, features, points)


def edges_to(
    frame: Frame, keyframe: FrameFeatures, first: Frame, T_first_frame: np.ndarray, on: bool = True
) -> list[Edge]:
    """To a frame whose pose is roughly known, from the first."""
    odometry = dataclasses.replace(CONFIG.odometry, against_map=on)
    motion = ConstantVelocity()
    tracker = MapTracker(dataclasses.replace(CONFIG, odometry=odometry), motion)
    motion.update(0, {})
    tracker.add(keyframe, first, {})
    motion.update(3, {0: T_first_frame})
    return tracker.track(3, frame, 0.9)


def test_the_edge_is_as_good_as_it_says(
    frames: list[Frame], described: FrameFeatures, truth: np.ndarray
) -> None:
    true = se3.inverse(truth[0]) @ truth[3]
    (edge,) = edges_to(frames[3], described, frames[0], true @ OFF_BY)
    off = se3.inverse(true) @ edge.T_i_j
    xi = np.concatenate([se3.log_so3(off[:3, :3]), off[:3, 3]])
    assert (edge.i, edge.j, edge.probability) == (0, 3, 0.9)
    assert xi @ edge.information @ xi < 22.5  # 6 degrees of freedom: 99.9 % are below
    assert np.linalg.norm(xi[3:]) < np.linalg.norm(OFF_BY[:3, 3])


def test_a_frame_that_shows_something_else_has_no_edge(
    frames: list[Frame], described: FrameFeatures, truth: np.ndarray
) -> None:
    true = se3.inverse(truth[0]) @ truth[3]
    other = dataclasses.replace(frames[3], color=frames[3].color[::-1, ::-1].copy())
    assert edges_to(other, described, frames[0], true) == []


def test_a_frame_of_another_track_has_no_edge(
    frames: list[Frame], described: FrameFeatures
) -> None:
    motion = ConstantVelocity()
    odometry = dataclasses.replace(CONFIG.odometry, against_map=True)
    tracker = MapTracker(dataclasses.replace(CONFIG, odometry=odometry), motion)
    motion.update(0, {})
    tracker.add(described, frames[0], {})
    motion.update(3, {})
    assert tracker.track(3, frames[3], 0.9) == []


def test_by_default_there_is_no_edge_by_patches(
    frames: list[Frame], described: FrameFeatures, truth: np.ndarray
) -> None:
    true = se3.inverse(truth[0]) @ truth[3]
    assert edges_to(frames[3], described, frames[0], true, on=False) == []
