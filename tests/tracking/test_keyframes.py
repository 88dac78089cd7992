"""Which frames become keyframes, and which keyframes a lost frame is matched with."""

import dataclasses

import numpy as np
import pytest

from vnav.config import Config
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.frame import Features
from vnav.core.mapping import FrameFeatures
from vnav.core.reduced_frame import ReducedFrame
from vnav.features.sift import SPACE
from vnav.tracking.keyframes import Keyframes, is_new_view
from vnav.tracking.pose_choice import TrackedFrame

CONFIG = Config().odometry  # 0.25 m, 15 degrees, half of the inliers
HERE = np.eye(4)


CAMERA = Intrinsics(8, 8, 8.0, 8.0, 3.5, 3.5)
IMAGE = ReducedFrame(0.0, np.zeros((8, 8)), np.zeros((8, 8)), CAMERA)


def frame(row: int, seed: int) -> TrackedFrame:
    """A frame whose descriptors are those of a scene."""
    n = 200
    descriptors = np.random.default_rng(seed).integers(0, 256, (n, 128)).astype(np.uint8)
    features = Features(np.zeros((n, 2)), descriptors, np.ones(n), np.ones(n), np.zeros(n), SPACE)
    points = np.full((n, 3), np.nan)
    return TrackedFrame(FrameFeatures(row, features, points), IMAGE, CAMERA)


def test_a_frame_that_sees_the_same_is_no_new_view() -> None:
    assert not is_new_view(HERE, 0.9, CONFIG)


@pytest.mark.parametrize(
    ("motion", "shared"),
    [([0, 0, 0, 0.3, 0, 0], 0.9), ([0, 0.3, 0, 0, 0, 0], 0.9), ([0, 0, 0, 0, 0, 0], 0.4)],
)
def test_a_frame_far_off_turned_away_or_with_few_shared_features_is_a_new_view(
    motion: list[float], shared: float
) -> None:
    assert is_new_view(se3.exp(motion), shared, CONFIG)


def test_recent_keyframes_come_newest_first_then_the_most_similar_of_the_rest() -> None:
    keyframes = Keyframes(dataclasses.replace(CONFIG, recent_keyframes=2, similar_keyframes=1))
    for row in range(6):
        keyframes.append(frame(row, seed=row))
    tried = keyframes.recent_and_similar(frame(6, seed=1).features)
    assert [k.features.row for k in tried] == [4, 3, 1]  # not 5, the last, which has been tried


def test_without_keyframes_there_is_none_to_match() -> None:
    keyframes = Keyframes(CONFIG)
    assert keyframes.last is None
    assert list(keyframes.recent_and_similar(frame(0, seed=0).features)) == []
