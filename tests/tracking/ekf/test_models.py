"""Models of motion and measurement: each Jacobian against finite differences."""

from collections.abc import Callable

import numpy as np
import pytest

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.tracking.ekf import quaternions
from vnav.tracking.ekf.measurement_model import measure, pixels
from vnav.tracking.ekf.motion_model import move, predict
from vnav.tracking.ekf.new_features import new_features, with_features
from vnav.tracking.ekf.state import (
    BEFORE,
    CAMERA,
    MOTION,
    POSE,
    ROTATION,
    FilterState,
    at_rest,
    with_unit_quaternion,
)

CAMERA_640 = Intrinsics(640, 480, 525.0, 520.0, 319.5, 239.5)
STEP = 1e-6
CLOSE = 1e-6  # relative: central differences of STEP leave 1e-10, rounding 1e-10 / STEP * 1e-6


def derivative(function: Callable[[Array], Array], at: Array) -> Array:
    """Of a function (N,) -> (M,), by central differences: (M, N)."""
    steps = STEP * np.eye(len(at))
    return np.stack([(function(at + s) - function(at - s)) / (2 * STEP) for s in steps], -1)


def state(rng: np.random.Generator, features: int = 3) -> FilterState:
    """A moving camera that sees some features, and a covariance without structure."""
    x = np.append(rng.normal(size=CAMERA), np.zeros(6 * features))
    x[ROTATION] /= np.linalg.norm(x[ROTATION])
    x[BEFORE][3:] /= np.linalg.norm(x[BEFORE][3:])
    px = rng.uniform((50, 50), (590, 430), (features, 2))
    y, *_ = new_features(x, px, rng.uniform(0.2, 2, features), CAMERA_640)
    x[CAMERA:] = y.reshape(-1)
    x[:3] += rng.normal(0, 0.05, 3)  # seen from elsewhere than where they were seen first
    A = rng.normal(size=(len(x), len(x)))
    return FilterState(x, 1e-4 * A @ A.T)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def test_quaternion_products_and_rotations_are_those_of_matrices(rng: np.random.Generator) -> None:
    q, p = rng.normal(size=(2, 4))
    both = quaternions.left_matrix(q) @ p
    assert both == pytest.approx(quaternions.right_matrix(p) @ q)
    product = se3.rotation_from_quat(q) @ se3.rotation_from_quat(p)
    assert se3.rotation_from_quat(both) == pytest.approx(product)


@pytest.mark.parametrize("size", [0.0, 1e-9, 0.3, 2.0])
def test_the_quaternion_of_a_rotation_vector_and_its_derivative(size: float) -> None:
    w = size * np.array([0.48, -0.6, 0.64])
    q, by_w = quaternions.from_rotation_vector(w)
    assert se3.rotation_from_quat(q) == pytest.approx(se3.exp_so3(w), abs=1e-12)
    numeric = derivative(lambda v: quaternions.from_rotation_vector(v)[0], w)
    assert by_w == pytest.approx(numeric, abs=CLOSE)


def test_derivatives_of_turned_vectors(rng: np.random.Generator) -> None:
    q, v = rng.normal(size=4), rng.normal(size=(1, 3))
    numeric = derivative(lambda p: se3.rotation_from_quat(p) @ v[0], q)
    assert quaternions.derivative_of_rotated(q, v)[0] == pytest.approx(numeric, abs=CLOSE)
    numeric = derivative(lambda p: se3.rotation_from_quat(p).T @ v[0], q)
    assert quaternions.derivative_of_turned_back(q, v)[0] == pytest.approx(numeric, abs=CLOSE)


def test_the_derivatives_of_motion(rng: np.random.Generator) -> None:
    camera, acceleration = state(rng).x[MOTION], rng.normal(size=6)
    _, F, G = move(camera, acceleration, 0.1)
    assert pytest.approx(derivative(lambda c: move(c, acceleration, 0.1)[0], camera)) == F
    assert pytest.approx(derivative(lambda a: move(camera, a, 0.1)[0], acceleration)) == G


def test_the_camera_moves_on_at_constant_velocities() -> None:
    start = at_rest(1.0, 1.0)
    x = start.x.copy()
    x[7:13] = 0.5, 0, -1, 0, 0.2, 0
    after = predict(FilterState(x, start.P), 0.25, 4.0, 6.0)
    assert after.x[:3] == pytest.approx([0.125, 0, -0.25])
    assert se3.log_so3(after.T_world_camera[:3, :3]) == pytest.approx([0, 0.05, 0])
    assert after.x[7:13] == pytest.approx(x[7:13])


def test_what_accelerations_may_do_adds_to_the_covariance() -> None:
    after = predict(at_rest(0.0, 0.0), 0.1, 4.0, 6.0)
    assert np.sqrt(np.diag(after.P)[:3]) == pytest.approx(4.0 * 0.1**2)
    assert np.sqrt(np.diag(after.P)[3:6]) == pytest.approx(6.0 * 0.1**2 / 2)
    assert np.sqrt(np.diag(after.P)[7:13]) == pytest.approx(np.repeat([0.4, 0.6], 3))


def test_the_derivatives_of_the_measurement(rng: np.random.Generator) -> None:
    start = state(rng)
    rows = np.array([2, 0])
    measured = measure(start, rows, CAMERA_640)
    numeric = derivative(lambda x: pixels(x, rows, CAMERA_640).reshape(-1), start.x)
    assert measured.times(np.eye(len(start.x))) == pytest.approx(numeric, rel=1e-5, abs=1e-4)
    assert measured.pixels == pytest.approx(pixels(start.x, rows, CAMERA_640))


def test_a_new_feature_is_seen_where_it_was_found(rng: np.random.Generator) -> None:
    px = np.array([[10.0, 20.0], [600.0, 400.0]])
    before = state(rng)
    after = with_features(before, px, np.array([0.5, 1.0]), np.ones(2), CAMERA_640, 1.0)
    assert pixels(after.x, np.array([3, 4]), CAMERA_640) == pytest.approx(px)


def test_a_new_feature_lies_at_its_depth() -> None:
    y, *_ = new_features(at_rest(1, 1).x, np.array([[100.0, 50.0]]), np.array([0.25]), CAMERA_640)
    point = CAMERA_640.unproject(np.array([100.0, 50.0]), 4.0)
    assert 1 / y[0, 5] == pytest.approx(np.linalg.norm(point))


def test_the_derivatives_of_new_features(rng: np.random.Generator) -> None:
    x = state(rng).x
    px, inverse = np.array([[100.0, 50.0]]), np.array([0.7])
    _, by_pose, by_pixel, by_inverse = new_features(x, px, inverse, CAMERA_640)

    def of_pose(pose: Array) -> Array:
        return new_features(np.append(pose, x[7:]), px, inverse, CAMERA_640)[0][0]

    def of_pixel(p: Array) -> Array:
        return new_features(x, p[None], inverse, CAMERA_640)[0][0]

    def of_inverse(value: Array) -> Array:
        return new_features(x, px, value, CAMERA_640)[0][0]

    assert by_pose[0] == pytest.approx(derivative(of_pose, x[POSE]), abs=CLOSE)
    assert by_pixel[0] == pytest.approx(derivative(of_pixel, px[0]), abs=CLOSE)
    assert by_inverse[0] == pytest.approx(derivative(of_inverse, inverse), abs=CLOSE)


def test_the_covariance_of_a_new_feature_is_that_of_its_jacobian(rng: np.random.Generator) -> None:
    before = state(rng)
    px, inverse = np.array([[100.0, 50.0]]), np.array([0.7])
    _, by_pose, by_pixel, by_inverse = new_features(before.x, px, inverse, CAMERA_640)
    after = with_features(before, px, inverse, np.array([0.3]), CAMERA_640, 2.0)
    n = len(before.x)
    J = np.zeros((n + 6, n + 3))
    J[:n, :n], J[n:, POSE] = np.eye(n), by_pose[0]
    J[n:, n : n + 2], J[n:, n + 2 :] = by_pixel[0], by_inverse[0]
    noise = np.zeros((n + 3, n + 3))
    noise[:n, :n], noise[n:, n:] = before.P, np.diag([4.0, 4.0, 0.09])
    assert pytest.approx(J @ noise @ J.T) == after.P


def test_a_quaternion_made_unit_takes_its_covariance_along(rng: np.random.Generator) -> None:
    start = state(rng)
    x = start.x.copy()
    x[ROTATION] *= 1.5
    after = with_unit_quaternion(x, start.P)
    J = derivative(lambda v: with_unit_quaternion(v, start.P).x, x)
    assert np.linalg.norm(after.x[ROTATION]) == pytest.approx(1)
    assert pytest.approx(J @ start.P @ J.T, abs=1e-9) == after.P


def test_the_covariance_of_a_step_is_that_of_the_relative_pose(rng: np.random.Generator) -> None:
    start = state(rng, features=0)
    T_camera_before = se3.inverse(start.T_before_camera)

    def off(x: Array) -> Array:
        return se3.deviation(T_camera_before @ FilterState(x, start.P).T_before_camera)

    J = derivative(off, start.x)
    assert start.step_covariance == pytest.approx(J @ start.P @ J.T, abs=1e-8)


def test_nothing_is_unknown_of_a_step_that_was_not_made(rng: np.random.Generator) -> None:
    here = state(rng).remembered()
    assert here.T_before_camera == pytest.approx(np.eye(4))
    assert here.step_covariance == pytest.approx(np.zeros((6, 6)), abs=1e-12)
    moved = predict(here, 0.0, 1.0, 1.0)
    assert moved.T_before_camera == pytest.approx(np.eye(4))
