"""Keyframes with features where a test puts them, and the map points that they share."""

import numpy as np
import pytest

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.descriptor_space import UNDESCRIBED
from vnav.core.frame import Features, Frame, PoseEstimate
from vnav.core.mapping import FrameFeatures
from vnav.tracking.local_map import CELL_PX, MIN_COVISIBILITY, LocalMap, covisibility

CAMERA = Intrinsics(320, 240, 262.5, 262.5, 159.5, 119.5)
DEPTH_M = 2.0
GRID = np.array([[u, v] for u in range(24, 312, 12) for v in range(24, 232, 12)], float)


def keyframe(row: int, px: Array = GRID) -> tuple[FrameFeatures, Frame]:
    """Features at these pixels of a wall two metres away."""
    none = np.zeros(len(px), np.float32)
    described = np.zeros((len(px), 0), np.uint8)
    features = Features(px.astype(np.float32), described, none, none, none, UNDESCRIBED)
    points = CAMERA.unproject(px, np.full(len(px), DEPTH_M)).astype(np.float32)
    depth = np.full((240, 320), DEPTH_M, np.float32)
    frame = Frame(0, row, row / 30, np.zeros((240, 320, 3), np.uint8), depth, CAMERA)
    return FrameFeatures(row, features, points), frame


def matched(theirs: Array, its: Array) -> PoseEstimate:
    inliers = np.stack([theirs, its], 1).astype(np.int32)
    return PoseEstimate(np.eye(4), np.eye(6), inliers, len(inliers))


def first(count: int) -> PoseEstimate:
    return matched(np.arange(count), np.arange(count))


def moved(*xyz: float) -> Array:
    return se3.make(np.eye(3), xyz)


def map_of(*shared: int) -> LocalMap:
    """As many keyframes and one more; each shares so many of its features with the one before."""
    local_map = LocalMap(0.0014)
    local_map.add(*keyframe(0), {})
    for row, count in enumerate(shared, 1):
        local_map.add(*keyframe(row), {row - 1: first(count)})
    return local_map


def test_covisibility_is_the_number_of_points_that_both_see() -> None:
    a, b, c = map_of(200, 120).keyframes
    assert (covisibility(a, b), covisibility(b, c), covisibility(a, c)) == (200, 120, 120)


def test_keyframes_that_share_too_little_with_the_newest_are_let_go() -> None:
    assert [k.row for k in map_of(100, MIN_COVISIBILITY - 1).keyframes] == [2]
    assert [k.row for k in map_of(100, MIN_COVISIBILITY).keyframes] == [0, 1, 2]


def test_each_cell_has_one_point_at_most() -> None:
    seen = map_of(100).visible({0: np.eye(4), 1: np.eye(4)}, CAMERA)
    px = np.concatenate([s.px for s in seen])
    cells = {tuple(c) for c in (px // CELL_PX).astype(int).tolist()}
    assert len(px) == len(cells) == 10 * 8  # all of 320 x 240 pixels


def test_a_cell_has_the_point_that_was_matched_most_often() -> None:
    # A cell of 32 pixels holds several points of the grid: one of them is matched once more.
    local_map = LocalMap(0.0014)
    local_map.add(*keyframe(0), {})
    (in_cell,) = np.nonzero(((GRID > [64, 64]) & (GRID < [96, 96])).all(1))
    local_map.count_matched(local_map.keyframes[0], in_cell[2:3])
    (seen,) = local_map.visible({0: np.eye(4)}, CAMERA)
    assert np.isin(in_cell, seen.rows).tolist() == [k == 2 for k in range(len(in_cell))]


def test_the_nearest_keyframe_that_saw_a_point_shows_it() -> None:
    local_map = map_of(len(GRID))
    by_row = {0: moved(0.02, 0, 0), 1: moved(0.3, 0, 0)}
    assert [s.keyframe.row for s in local_map.visible(by_row, CAMERA)] == [0]
    by_row[0] = moved(-0.4, 0, 0)
    nearest, *others = local_map.visible(by_row, CAMERA)
    assert nearest.keyframe.row == 1
    assert all(s.keyframe.row == 0 for s in others)


def test_points_are_expected_where_the_camera_sees_them() -> None:
    local_map = LocalMap(0.0014)
    local_map.add(*keyframe(0), {})
    (seen,) = local_map.visible({0: moved(0.1, 0, 0)}, CAMERA)  # 10 cm at 2 m: 13.1 pixels
    np.testing.assert_allclose(seen.px, GRID[seen.rows] + [13.125, 0], atol=1e-3)


def test_no_more_than_ten_keyframes_are_referred_to() -> None:
    local_map = map_of(*[50] * 11)
    # The rest of each keyframe's features are points of its own, in cells that all share.
    poses = {row: moved(0, 0, 0.001 * (12 - row)) for row in range(12)}
    rows = {s.keyframe.row for s in local_map.visible(poses, CAMERA)}
    assert len(local_map.keyframes) == 12
    assert len(rows) <= 10


def test_keyframes_whose_pose_is_not_known_are_left_out() -> None:
    local_map = map_of(100)
    assert {s.keyframe.row for s in local_map.visible({0: np.eye(4)}, CAMERA)} == {0}
    assert local_map.visible({}, CAMERA) == []


def slopes_of(slant: float, sigma: float) -> Array:
    """What a keyframe knows of a slanted wall, by depth with that noise: (N, 2) of the grid."""
    u = np.tile(np.arange(320.0), (240, 1))
    inverse = 0.5 + slant * (u - CAMERA.cx) / CAMERA.fx / DEPTH_M
    inverse += np.random.default_rng(0).normal(0, sigma, inverse.shape)
    features, frame = keyframe(0)
    slanted = Frame(0, 0, 0.0, frame.color, (1 / inverse).astype(np.float32), CAMERA)
    local_map = LocalMap(0.0014)
    local_map.add(features, slanted, {})
    return local_map.keyframes[0].surface[:, 1:]


@pytest.mark.parametrize("slant", [0.0, 0.4])
def test_a_keyframe_knows_the_slopes_of_its_surfaces(slant: float) -> None:
    expected = np.tile([slant / CAMERA.fx / DEPTH_M, 0.0], (len(GRID), 1))
    np.testing.assert_allclose(slopes_of(slant, 0.0), expected, atol=1e-6)


@pytest.mark.parametrize("times", [1.0, 3.0])
def test_it_knows_them_in_more_noise_than_the_settings_say(times: float) -> None:
    sigma = times * 0.0014
    off = slopes_of(0.4, sigma) - [0.4 / CAMERA.fx / DEPTH_M, 0.0]
    # Of 9 x 9 pixels: sigma over the root of 9 times the sum of squares from -4 to 4, which is 60.
    # With 432 slopes, whose windows overlap little at 12 px, its estimate varies by 4 %.
    assert np.sqrt((off**2).mean()) < 1.15 * sigma / np.sqrt(9 * 60)
