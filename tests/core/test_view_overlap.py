"""Views of a wall from poses that are chosen."""

import numpy as np

from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.frame import Features
from vnav.core.mapping import FrameFeatures, FrameTable, Odometry
from vnav.core.view_overlap import view_overlap
from vnav.features.sift import SPACE

CAMERA = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)


def keyframe(row: int, with_depth: int = 100) -> FrameFeatures:
    """Points on a wall 2 m ahead, all over the image."""
    px = np.random.default_rng(row).uniform([0, 0], [639, 479], (100, 2))
    points = CAMERA.unproject(px, np.full(100, 2.0))
    points[with_depth:] = np.nan
    ones = np.ones(100, np.float32)
    features = Features(
        px.astype(np.float32), np.zeros((100, 128), np.uint8), ones, ones, ones, SPACE
    )
    return FrameFeatures(row, features, points.astype(np.float32))


def odometry(keyframes: list[FrameFeatures]) -> Odometry:
    n = len(keyframes)
    frames = FrameTable(np.zeros(n), np.arange(n), np.arange(n))
    poses, segment = np.stack([np.eye(4)] * n), np.zeros(n, np.int32)
    return Odometry(frames, poses, segment, ("",) * n, (), tuple(keyframes))


def overlap_of(*T_world_camera: np.ndarray, part: list[int] | None = None) -> np.ndarray:
    n = len(T_world_camera)
    parts = np.array(part or [0] * n, np.int32)
    walk = odometry([keyframe(row) for row in range(n)])
    return view_overlap(walk, np.stack(T_world_camera), parts, [CAMERA])


def test_views_of_one_place_overlap_and_views_of_opposite_walls_do_not() -> None:
    # 0.6 m aside at 2 m are 158 of 640 px: a quarter of the points leave the image.
    aside, back = se3.exp([0, 0, 0, 0.6, 0, 0]), se3.exp([0, np.pi, 0, 0, 0, 0])
    overlap = overlap_of(np.eye(4), aside, back)
    assert 0.6 < overlap[0, 1] < 0.9
    assert not overlap[2].any()
    np.testing.assert_array_equal(overlap, overlap.T)


def test_frames_of_different_parts_do_not_overlap_wherever_they_are() -> None:
    assert not overlap_of(np.eye(4), np.eye(4), part=[0, 1]).any()


def test_a_keyframe_without_depth_overlaps_with_none() -> None:
    walk = odometry([keyframe(0), keyframe(1, with_depth=0)])
    poses = np.stack([np.eye(4)] * 2)
    assert not view_overlap(walk, poses, np.zeros(2, np.int32), [CAMERA]).any()
