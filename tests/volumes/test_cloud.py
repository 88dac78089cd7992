"""What is refused of a depth image, and how points are merged by voxels."""

import numpy as np
import pytest

from vnav.config import FuseConfig
from vnav.volumes.cloud import VoxelCloud, filter_depth, voxels_of

RNG = np.random.default_rng(0)
CONFIG = FuseConfig()


def wall(depth_m: float = 2.0) -> np.ndarray:
    return np.full((48, 64), depth_m, np.float32)


def floor_seen_at_a_grazing_angle() -> np.ndarray:
    """Depth of a floor 1.25 m below a level camera: 1.6 m in the last row, 3.9 m in the first."""
    v = np.arange(240, 480)[:, None]
    z = 1.25 * 525 / (v - 70)
    return np.broadcast_to(z, (240, 64)).astype(np.float32)


def test_a_wall_is_kept_whole() -> None:
    np.testing.assert_array_equal(filter_depth(wall(), CONFIG), wall())


def test_a_slanted_plane_is_no_edge() -> None:
    depth = floor_seen_at_a_grazing_angle()
    assert np.diff(depth, axis=0).min() < -0.02  # steps of centimetres from row to row
    np.testing.assert_array_equal(filter_depth(depth, CONFIG), depth)


def test_sensor_noise_is_no_edge() -> None:
    # 0.0025 z^2 of axial noise is 0.0025 in inverse depth; a second difference has sqrt(6) of it:
    # 0.015 lies 2.4 sigma out, which 1.4 % of pixels reach along each axis.
    noisy = 1 / (1 / wall() + RNG.normal(0, 0.0025, (48, 64)))
    assert (filter_depth(noisy.astype(np.float32), CONFIG) > 0).mean() > 0.95


def test_both_sides_of_a_depth_edge_are_refused() -> None:
    depth = wall(3.0)
    depth[:, :30] = 2.0
    kept = filter_depth(depth, CONFIG) > 0
    assert not kept[:, 29:31].any()
    assert kept[:, :29].all()
    assert kept[:, 31:].all()


def test_pixels_that_fly_between_two_surfaces_are_refused() -> None:
    depth = wall(3.0)
    depth[:, :30] = 2.0
    depth[:, 30] = 2.5
    kept = filter_depth(depth, CONFIG)
    assert set(np.unique(kept)) == {0, 2, 3}


def test_a_leg_three_pixels_wide_leaves_something() -> None:
    depth = wall(3.0)
    depth[:, 30:33] = 2.0
    assert (filter_depth(depth, CONFIG)[:, 31] == 2).all()


def test_an_isolated_pixel_is_refused() -> None:
    depth = np.zeros((48, 64), np.float32)
    depth[20, 20] = 2
    assert not filter_depth(depth, CONFIG).any()


def test_a_line_two_pixels_wide_is_not_isolated() -> None:
    depth = np.zeros((48, 64), np.float32)
    depth[:, 20:22] = 2
    assert (filter_depth(depth, CONFIG)[1:-1, 20:22] == 2).all()


def test_depth_out_of_range_is_refused() -> None:
    assert not filter_depth(wall(CONFIG.max_range_m + 0.01), CONFIG).any()


def test_no_depth_stays_no_depth() -> None:
    assert not filter_depth(wall(0), CONFIG).any()


def test_the_first_point_of_each_voxel_is_chosen() -> None:
    points = RNG.uniform(-1, 1, (5000, 3))
    voxels = np.floor(points / 0.1).astype(int)
    _, first, voxel = np.unique(voxels, axis=0, return_index=True, return_inverse=True)
    np.testing.assert_array_equal(voxels_of(points, 0.1)[0], first)
    np.testing.assert_array_equal(voxels_of(points, 0.1)[1], voxel.ravel())


def test_no_points_have_no_voxels() -> None:
    assert [len(rows) for rows in voxels_of(np.zeros((0, 3)), 0.1)] == [0, 0]


def test_a_voxel_holds_the_mean_of_all_that_was_put_in() -> None:
    cloud = VoxelCloud(1.0)
    points = np.array([[0.2, 0.2, 0.2], [0.6, 0.4, 0.2], [-0.5, 0.5, 0.5]])
    cloud.add(points[:1], np.array([[10, 20, 30]], np.uint8))
    cloud.add(points[1:], np.array([[20, 40, 31], [7, 8, 9]], np.uint8))
    merged = cloud.cloud()
    np.testing.assert_allclose(merged.points_world, [[-0.5, 0.5, 0.5], [0.4, 0.3, 0.2]], atol=1e-6)
    np.testing.assert_array_equal(merged.colors, [[7, 8, 9], [15, 30, 30]])


def test_many_scans_merge_as_one() -> None:
    points = RNG.uniform(-1, 1, (20_000, 3))
    colors = RNG.integers(0, 256, (20_000, 3)).astype(np.uint8)
    whole, parts = VoxelCloud(0.2), VoxelCloud(0.2)
    whole.add(points, colors)
    for k in range(0, 20_000, 1000):
        parts.add(points[k : k + 1000], colors[k : k + 1000])
    # float32 of means up to 1: sums in another order differ by an ulp
    np.testing.assert_allclose(
        whole.cloud().points_world, parts.cloud().points_world, atol=1.2e-7, rtol=0
    )
    assert len(parts.cloud()) == 10**3


def test_memory_is_bounded_by_the_voxels() -> None:
    cloud = VoxelCloud(1.0)
    room = len(cloud._sum)
    for _ in range(50):
        cloud.add(RNG.uniform(0, 2, (1000, 3)), np.zeros((1000, 3), np.uint8))
    assert len(cloud.cloud()) == 8
    assert len(cloud._sum) == room < 50 * 1000


def test_a_cloud_that_outgrows_its_room_keeps_every_voxel() -> None:
    points = RNG.uniform(-4, 4, (60_000, 3))
    colors = RNG.integers(0, 256, (60_000, 3)).astype(np.uint8)
    cloud = VoxelCloud(0.2)
    room = len(cloud._sum)
    cloud.add(points, colors)
    voxels = np.floor(points / 0.2).astype(int)
    _, voxel, count = np.unique(voxels, axis=0, return_inverse=True, return_counts=True)
    mean = np.stack([np.bincount(voxel.ravel(), axis) / count for axis in points.T], 1)
    assert len(count) > 2 * room
    np.testing.assert_allclose(cloud.cloud().points_world, mean, atol=1e-6)


@pytest.mark.parametrize("scans", [0, 1])
def test_nothing_put_in_is_an_empty_cloud(scans: int) -> None:
    cloud = VoxelCloud(0.1)
    for _ in range(scans):
        cloud.add(np.zeros((0, 3)), np.zeros((0, 3), np.uint8))
    assert len(cloud.cloud()) == 0
