"""Transforms and rotations. Exact claims are held to 1e-9: rounding alone, far from any noise."""

import numpy as np
import pytest

from vnav.core import se3

ROUNDING = 1e-9


def rotation_vectors(angles: list[float]) -> np.ndarray:
    """Rotation vectors (N, 3) of the given angles about random axes."""
    axes = np.random.default_rng(0).standard_normal((len(angles), 3))
    return axes / np.linalg.norm(axes, axis=1, keepdims=True) * np.array(angles)[:, None]


VECTORS = rotation_vectors([0, 1e-12, 1e-7, 1e-4, 0.3, 1.5, 3.0, np.pi - 1e-7])
R = se3.exp_so3(VECTORS)
T = se3.make(R, np.random.default_rng(1).uniform(-5, 5, (len(R), 3)))


def test_exp_and_log_undo_each_other_at_every_angle() -> None:
    np.testing.assert_allclose(se3.log_so3(R), VECTORS, atol=ROUNDING)


def test_half_a_turn_has_a_rotation_vector_of_length_pi() -> None:
    for axis in np.eye(3):
        half = 2 * np.outer(axis, axis) - np.eye(3)
        w = se3.log_so3(half)
        assert np.linalg.norm(w) == pytest.approx(np.pi, abs=ROUNDING)
        np.testing.assert_allclose(se3.exp_so3(w), half, atol=ROUNDING)


def test_quaternion_and_rotation_undo_each_other() -> None:
    np.testing.assert_allclose(se3.rotation_from_quat(se3.quat_xyzw(R)), R, atol=ROUNDING)


def test_rotations_that_rounding_has_spoiled_become_exact() -> None:
    noise = np.random.default_rng(2).uniform(-1e-5, 1e-5, (len(T), 3, 3))
    spoiled = T.copy()
    spoiled[:, :3, :3] += noise
    exact = se3.orthonormal(spoiled)
    assert not se3.is_rigid(spoiled, ROUNDING)
    assert se3.is_rigid(exact, ROUNDING)
    np.testing.assert_allclose(exact, T, atol=5e-5)


def test_the_quaternion_of_a_quarter_turn_about_z_puts_w_last() -> None:
    quarter = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    half = np.sqrt(0.5)
    np.testing.assert_allclose(se3.quat_xyzw(quarter), [0, 0, half, half], atol=ROUNDING)


def test_a_quaternion_of_any_length_is_a_rotation() -> None:
    np.testing.assert_allclose(
        se3.rotation_from_quat(-7 * se3.quat_xyzw(R)), se3.rotation_from_quat(se3.quat_xyzw(R))
    )


def test_a_transform_and_its_inverse_cancel() -> None:
    np.testing.assert_allclose(
        se3.inverse(T) @ T, np.broadcast_to(np.eye(4), T.shape), atol=ROUNDING
    )


def test_transform_maps_points_of_b_into_a() -> None:
    T_a_b = se3.make([[0, -1, 0], [1, 0, 0], [0, 0, 1]], [10, 0, 0])
    np.testing.assert_allclose(se3.transform(T_a_b, [[1, 2, 3]]), [[8, 1, 3]])


def test_stacks_are_transformed_as_one_by_one() -> None:
    points = np.random.default_rng(2).uniform(-1, 1, (7, 3))
    one_by_one = [se3.transform(t, points) for t in T]
    np.testing.assert_allclose(se3.transform(T, points), one_by_one, atol=ROUNDING)
    np.testing.assert_allclose(se3.inverse(T), [se3.inverse(t) for t in T], atol=ROUNDING)
    np.testing.assert_allclose(se3.quat_xyzw(T), [se3.quat_xyzw(t) for t in T], atol=ROUNDING)


def test_exp_moves_along_a_screw() -> None:
    # A quarter turn while going pi/2 forward along its tangent: a quarter of the unit circle.
    moved = se3.exp([0, 0, np.pi / 2, np.pi / 2, 0, 0])
    np.testing.assert_allclose(moved[:3, 3], [1, 1, 0], atol=ROUNDING)
    np.testing.assert_allclose(moved[:3, :3] @ [1, 0, 0], [0, 1, 0], atol=ROUNDING)


def test_ten_tenths_of_a_motion_are_the_motion() -> None:
    for w in VECTORS:
        xi = np.concatenate([w, [0.3, -2.0, 1.0]])
        tenths = np.linalg.matrix_power(se3.exp(xi / 10), 10)
        np.testing.assert_allclose(tenths, se3.exp(xi), atol=ROUNDING)


def test_rotation_angle_is_that_of_the_vector() -> None:
    np.testing.assert_allclose(
        se3.rotation_angle(T), np.linalg.norm(VECTORS, axis=1), atol=ROUNDING
    )


def test_align_finds_the_motion_of_exact_points() -> None:
    for T_a_b in T:
        b = np.random.default_rng(3).uniform(-3, 3, (6, 3))
        np.testing.assert_allclose(se3.align(se3.transform(T_a_b, b), b), T_a_b, atol=ROUNDING)


def test_align_stays_a_rotation_where_all_points_lie_on_a_plane() -> None:
    # Three points always do; a mirror image would fit them as well.
    for seed in range(20):
        b = np.random.default_rng(seed).uniform(-3, 3, (3, 3))
        np.testing.assert_allclose(se3.align(se3.transform(T[5], b), b), T[5], atol=1e-6)


def test_align_errs_no_more_than_the_noise_of_the_points() -> None:
    # The mean of n points is uncertain by sigma / sqrt(n), and each of two clouds adds its own;
    # about the mean, points that spread by s per axis give rotations to sigma / (s sqrt(n)).
    # Five standard deviations over three axes: one in a hundred thousand.
    sigma, n, spread = 0.01, 400, 2.0
    rng = np.random.default_rng(4)
    b = rng.normal(0, spread, (n, 3))
    noisy = se3.transform(T[4], b) + rng.normal(0, sigma, b.shape)
    error = se3.inverse(T[4]) @ se3.align(noisy, b + rng.normal(0, sigma, b.shape))
    limit = 5 * sigma * np.sqrt(2 * 3 / n)
    assert np.linalg.norm(error[:3, 3]) < limit
    assert se3.rotation_angle(error) < limit / spread


def test_align_takes_stacks() -> None:
    b = np.random.default_rng(5).uniform(-3, 3, (len(T), 5, 3))
    np.testing.assert_allclose(se3.align(se3.transform(T, b), b), T, atol=ROUNDING)


def test_align_of_points_on_a_line_is_still_a_rigid_transform() -> None:
    line = np.outer(np.arange(5.0), [1, 2, 3])
    assert se3.is_rigid(se3.align(line, line))
    assert se3.is_rigid(se3.align(np.ones((4, 3)), np.ones((4, 3))))


def test_is_rigid_refuses_scale_mirror_and_nan() -> None:
    assert se3.is_rigid(T)
    assert not se3.is_rigid(np.diag([2.0, 2, 2, 1]))
    assert not se3.is_rigid(np.diag([1.0, 1, -1, 1]))
    assert not se3.is_rigid(np.full((4, 4), np.nan))
    assert not se3.is_rigid(np.diag([1.0, 1, 1, 2]))


def test_arguments_are_left_alone() -> None:
    given = T.copy()
    se3.inverse(given)
    se3.log_so3(given[:, :3, :3])
    se3.align(given[:, :3, 3], given[:, :3, 3])
    np.testing.assert_array_equal(given, T)
