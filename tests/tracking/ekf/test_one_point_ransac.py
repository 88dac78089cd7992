"""Which matches agree on one motion: a camera, forty features, and matches that are wrong."""

from dataclasses import dataclass

import numpy as np
import pytest

from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.tracking.ekf.measurement_model import Measurement, measure, pixels
from vnav.tracking.ekf.motion_model import predict
from vnav.tracking.ekf.new_features import with_features
from vnav.tracking.ekf.one_point_ransac import (
    draws_needed,
    high_innovation_inliers,
    low_innovation_inliers,
)
from vnav.tracking.ekf.state import FilterState, at_rest
from vnav.tracking.ekf.update import innovation_covariances, updated

CAMERA = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
FEATURES, STEP_S, SIGMA_PX = 40, 0.1, 1.0


@dataclass(frozen=True)
class Step:
    """A predicted state, and where features are found after what the camera really did."""

    state: FilterState
    truth: Array  # mean of the state
    measurement: Measurement
    found_px: Array


@pytest.fixture
def step() -> Step:
    """A camera that was at rest moves by 3 cm and turns by 1 degree: found to half a pixel."""
    rng = np.random.default_rng(1)
    px = rng.uniform((40, 40), (600, 440), (FEATURES, 2))
    inverse = rng.uniform(0.2, 1.5, FEATURES)
    start = with_features(
        at_rest(0.1, 0.1), px, inverse, np.full(FEATURES, 0.0014), CAMERA, SIGMA_PX
    )
    state = predict(start, STEP_S, 4.0, 6.0)
    truth = state.x.copy()
    truth[:3] += [0.02, -0.01, 0.02]
    truth[3:7] = [0, np.sin(np.deg2rad(0.5)), 0, np.cos(np.deg2rad(0.5))]
    rows = np.arange(FEATURES)
    found = pixels(truth, rows, CAMERA) + rng.normal(0, 0.5, (FEATURES, 2))
    return Step(state, truth, measure(state, rows, CAMERA), found)


def with_outliers(step: Step, count: int) -> Array:
    """The places with the first of them 20 px off, each in its own direction."""
    angle = np.random.default_rng(2).uniform(0, 2 * np.pi, count)
    found = step.found_px.copy()
    found[:count] += 20 * np.stack([np.cos(angle), np.sin(angle)], 1)
    return found


def test_the_draws_of_the_source_are_these() -> None:
    """[000 section 3.2] prints 145 for five matches, where 145.05 draws are not done with 145."""
    one, five = draws_needed(0.5, 1, 0.99), draws_needed(0.5, 5, 0.99)
    assert (one, five) == (pytest.approx(6.64, abs=0.005), pytest.approx(145.05, abs=0.005))
    assert (np.ceil(one), np.ceil(five)) == (7, 146)


def test_no_right_match_takes_forever_and_right_ones_alone_one_draw() -> None:
    assert draws_needed(0.0, 1) == np.inf
    assert draws_needed(1.0, 1) == 1


@pytest.mark.parametrize("size", [1, 3])
def test_wrong_matches_are_left_out(step: Step, size: int) -> None:
    found, rng = with_outliers(step, 15), np.random.default_rng(0)
    consensus = low_innovation_inliers(
        step.state, step.measurement, found, CAMERA, SIGMA_PX, rng, size
    )
    assert not set(consensus.rows) & set(range(15))
    assert len(consensus.rows) >= 5  # what a frame is not lost with


def test_fewer_draws_are_needed_where_more_matches_are_right(step: Step) -> None:
    def draws(found: Array) -> int:
        rng = np.random.default_rng(0)
        return low_innovation_inliers(
            step.state, step.measurement, found, CAMERA, SIGMA_PX, rng
        ).draws

    assert draws(step.found_px) < draws(with_outliers(step, 30))


def test_no_match_is_no_consensus(step: Step) -> None:
    none = np.zeros(0, np.intp)
    consensus = low_innovation_inliers(
        step.state, step.measurement[none], np.zeros((0, 2)), CAMERA, SIGMA_PX,
        np.random.default_rng(0),
    )  # fmt: skip
    assert (len(consensus.rows), consensus.draws) == (0, 0)


def test_high_innovations_are_rescued_by_the_updated_state(step: Step) -> None:
    found, rows = with_outliers(step, 10), np.arange(FEATURES)
    low = rows[10:20]
    state = updated(step.state, step.measurement[low], found[low], SIGMA_PX)
    rest = np.setdiff1d(rows, low)
    expected = measure(state, rest, CAMERA)
    high = rest[high_innovation_inliers(state, expected, found[rest], SIGMA_PX)]
    assert not set(high) & set(range(10))
    # noise of half the sigma that is allowed for: chi-squared of 9.21 leaves none of 20 out
    assert len(high) == 20


def test_an_update_comes_near_to_the_truth_and_knows_how_near(step: Step) -> None:
    state = updated(step.state, step.measurement, step.found_px, SIGMA_PX)
    off = (state.x - step.truth)[:7]
    sigma = np.sqrt(np.diag(state.P)[:7])
    assert (np.abs(off) < 4 * sigma + 1e-9).all()
    assert (sigma[:3] < 0.2 * np.sqrt(np.diag(step.state.P)[:3])).all()
    assert np.linalg.norm(state.x[3:7]) == pytest.approx(1)
    np.testing.assert_array_equal(state.P, state.P.T)
    assert np.linalg.eigvalsh(state.P).min() > -1e-9


def test_an_update_is_that_of_josephs_form(step: Step) -> None:
    """``(I - K H) P (I - K H)' + K R K'`` written out, and the quaternion made unit by hand."""
    P, H = step.state.P, step.measurement.times(np.eye(len(step.state.x)))
    R = SIGMA_PX**2 * np.eye(len(H))
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    x = step.state.x + K @ (step.found_px - step.measurement.pixels).reshape(-1)
    left = np.eye(len(P)) - K @ H
    joseph = left @ P @ left.T + K @ R @ K.T
    q = x[3:7]
    J = np.eye(len(P))
    J[3:7, 3:7] = (np.eye(4) - np.outer(q, q) / (q @ q)) / np.linalg.norm(q)
    x[3:7] /= np.linalg.norm(q)
    state = updated(step.state, step.measurement, step.found_px, SIGMA_PX)
    assert state.x == pytest.approx(x, abs=1e-9)
    assert pytest.approx(J @ joseph @ J.T, abs=1e-9) == state.P


def test_covariances_of_pixels_alone_are_blocks_of_that_of_all(step: Step) -> None:
    rows = step.measurement
    S = rows.times(rows.times(step.state.P).T) + SIGMA_PX**2 * np.eye(2 * FEATURES)
    alone = innovation_covariances(step.state.P, rows, SIGMA_PX)
    blocks = [S[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] for k in range(FEATURES)]
    assert alone == pytest.approx(np.array(blocks))
