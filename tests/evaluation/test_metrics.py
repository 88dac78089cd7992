import importlib
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from vnav.core import se3
from vnav.evaluation import metrics

Array = NDArray[np.float64]


def _walk(seed: int, count: int = 200) -> Array:
    """Poses (N, 4, 4) of a hand-held walk: steps of 3 cm and 2 deg in changing directions."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(0, [0.02, 0.02, 0.02, 0.02, 0.02, 0.02], (count, 6))
    steps[:, 5] += 0.02
    poses = [np.eye(4)]
    for step in se3.exp(steps[1:]):
        poses.append(poses[-1] @ step)
    return np.array(poses)


def _drifting(T_truth_camera: Array, seed: int) -> Array:
    """The same walk estimated with drift, in another world, 2 % too small."""
    rng = np.random.default_rng(seed)
    drift = np.cumsum(rng.normal(0, 0.002, (len(T_truth_camera), 6)), 0)
    drifted = se3.exp([0.3, -1.0, 2.0, 4.0, -5.0, 6.0]) @ T_truth_camera @ se3.exp(drift)
    drifted[:, :3, 3] *= 0.98
    return drifted


def test_ate_is_zero_for_the_same_walk_in_another_world() -> None:
    truth = _walk(0)
    T_world_truth = se3.exp([2.0, -1.0, 0.5, 3.0, 1.0, -2.0])
    error = metrics.absolute_error(T_world_truth @ truth, truth)
    assert error.translation_m.max < 1e-12
    np.testing.assert_allclose(error.T_truth_world, se3.inverse(T_world_truth), atol=1e-12)


def test_ate_of_a_case_computed_by_hand() -> None:
    # A square of 2 m, one corner lifted by 0.4 m and its opposite as much, the others lowered:
    # no rigid motion does better than the plane through the middle, so each is off by 0.4 m.
    truth = _at([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
    estimate = _at([[1, 1, 0.4], [-1, 1, -0.4], [-1, -1, 0.4], [1, -1, -0.4]])
    statistics = metrics.absolute_error(estimate, truth).translation_m
    np.testing.assert_allclose(list(vars(statistics).values()), 0.4, atol=1e-12)


def test_the_scale_is_told_and_not_applied() -> None:
    truth = _walk(1)
    half = truth.copy()
    half[:, :3, 3] /= 2
    error = metrics.absolute_error(half, truth)
    assert error.scale == pytest.approx(2.0, abs=1e-9)
    centred = truth[:, :3, 3] - truth[:, :3, 3].mean(0)
    expected = np.sqrt((centred**2).sum(1).mean()) / 2
    assert error.translation_m.rmse == pytest.approx(expected, rel=1e-9)


def test_a_similarity_makes_a_walk_of_another_scale_the_same() -> None:
    truth = _walk(1)
    small = se3.exp([2.0, -1.0, 0.5, 3.0, 1.0, -2.0]) @ truth
    small[:, :3, 3] *= 0.4
    before = small.copy()
    grown, scale = metrics.scaled(small, truth)
    assert scale == pytest.approx(2.5)
    assert metrics.absolute_error(grown, truth).translation_m.max < 1e-12
    np.testing.assert_array_equal(small, before)


def test_an_estimate_that_never_moves_has_no_scale() -> None:
    truth = _walk(2)
    error = metrics.absolute_error(np.repeat(np.eye(4)[None], len(truth), 0), truth)
    assert np.isnan(error.scale)
    assert error.translation_m.rmse > 0


def test_statistics_of_a_case_computed_by_hand() -> None:
    statistics = metrics.Statistics.of([1.0, -2.0, 2.0, 4.0])
    assert vars(statistics) == {"rmse": 2.5, "mean": 2.25, "median": 2.0, "max": 4.0}


def test_statistics_of_nothing_are_no_number() -> None:
    assert np.isnan(list(vars(metrics.Statistics.of([])).values())).all()


def test_rpe_ignores_the_world_but_not_the_motion() -> None:
    truth = _walk(3)
    moved = se3.exp([1.0, 2.0, 0.5, 9.0, 8.0, 7.0]) @ truth
    pairs = metrics.pairs_over_frames(len(truth), 5)
    assert metrics.relative_error(moved, truth, pairs).translation_m.max < 1e-12
    assert metrics.relative_error(_drifting(truth, 0), truth, pairs).translation_m.rmse > 1e-3


def test_rpe_over_a_second_of_a_case_computed_by_hand() -> None:
    # Truth drives 1 m/s along x for 2 s, a pose every quarter of a second. The estimate drives as
    # fast, but turns 3 deg about z at 1 s and keeps that heading. Five pairs are a second apart.
    # The first ends where the turn is made: right place, 3 deg off. The next three drive 0.25,
    # 0.5 and 0.75 m after the turn, where each metre goes off by the chord 2 sin(1.5 deg). The
    # last begins with the new heading and makes no error at all.
    stamps_s = np.arange(9) * 0.25
    truth = _at([[t, 0, 0] for t in stamps_s])
    turned = se3.exp_so3([0, 0, np.deg2rad(3)])
    after = turned @ (np.array([1.0, 0, 0])[:, None] * (stamps_s[4:] - 1))
    estimate = truth.copy()
    estimate[4:] = se3.make(turned, after.T + [1.0, 0, 0])
    pairs = metrics.pairs_over_time(stamps_s, 1.0)
    assert pairs.tolist() == [[0, 4], [1, 5], [2, 6], [3, 7], [4, 8]]
    error = metrics.relative_error(estimate, truth, pairs)
    off_m = np.array([0, 0.25, 0.5, 0.75, 0]) * 2 * np.sin(np.deg2rad(1.5))
    assert error.translation_m.rmse == pytest.approx(np.sqrt((off_m**2).mean()), abs=1e-12)
    assert error.translation_m.mean == pytest.approx(off_m.mean(), abs=1e-12)
    assert error.translation_m.median == pytest.approx(np.median(off_m), abs=1e-12)
    assert error.translation_m.max == pytest.approx(off_m[3], abs=1e-12)
    assert error.rotation_deg.mean == pytest.approx(3 * 4 / 5, abs=1e-9)
    assert error.rotation_deg.max == pytest.approx(3, abs=1e-9)
    assert error.pairs == 5


def test_no_pair_bridges_a_gap_in_time() -> None:
    stamps_s = np.array([0.0, 0.5, 1.0, 3.0, 3.5])
    assert metrics.pairs_over_time(stamps_s, 1.0).tolist() == [[0, 2]]


def test_a_pair_over_a_distance_is_measured_along_the_path() -> None:
    there_and_back = np.array([[0, 0, 0], [0.5, 0, 0], [0, 0, 0], [0.5, 0, 0]])
    assert metrics.pairs_over_path(there_and_back, 1.0).tolist() == [[0, 2], [1, 3]]


def test_too_short_a_trajectory_has_no_pairs() -> None:
    for pairs in (
        metrics.pairs_over_frames(3, 3),
        metrics.pairs_over_path(np.zeros((4, 3)), 1.0),
        metrics.pairs_over_time(np.zeros(0), 1.0),
    ):
        assert pairs.shape == (0, 2)
    nothing = metrics.relative_error(_walk(0, 3), _walk(0, 3), pairs)
    assert nothing.pairs == 0
    assert np.isnan(nothing.translation_m.rmse)


def test_relocalisation_error_is_distance_and_angle() -> None:
    truth = _walk(4, 2)
    off = se3.make(se3.exp_so3([0, np.deg2rad(10), 0]), [0.3, 0, 0.4])
    distance_m, angle_deg = metrics.relocalisation_error(truth @ off, truth)
    np.testing.assert_allclose(distance_m, 0.5, atol=1e-12)
    np.testing.assert_allclose(angle_deg, 10, atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_ate_agrees_with_evo(seed: int) -> None:
    evo, truth = _evo(), _walk(seed)
    estimate = _drifting(truth, seed)
    reference, aligned = evo.path(truth), evo.path(estimate)
    _, _, scale = aligned.align(reference, correct_scale=True)
    aligned = evo.path(estimate)
    aligned.align(reference)
    ape = evo.metrics.APE(evo.relation.translation_part)
    ape.process_data((reference, aligned))
    ours = metrics.absolute_error(estimate, truth)
    _assert_same(ours.translation_m, ape)
    assert ours.scale == pytest.approx(scale, abs=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_ate_after_a_similarity_agrees_with_evo(seed: int) -> None:
    evo, truth = _evo(), _walk(seed)
    estimate = _drifting(truth, seed)
    estimate[:, :3, 3] *= 0.3
    reference, aligned = evo.path(truth), evo.path(estimate)
    _, _, theirs = aligned.align(reference, correct_scale=True)
    ape = evo.metrics.APE(evo.relation.translation_part)
    ape.process_data((reference, aligned))
    grown, scale = metrics.scaled(estimate, truth)
    assert scale == pytest.approx(theirs, abs=1e-9)
    _assert_same(metrics.absolute_error(grown, truth).translation_m, ape)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("unit", "delta"), [("frames", 1), ("frames", 10), ("meters", 1.0)])
def test_rpe_agrees_with_evo(seed: int, unit: str, delta: float) -> None:
    evo, truth = _evo(), _walk(seed)
    estimate = _drifting(truth, seed)
    over_path = unit == "meters"
    pairs = (
        metrics.pairs_over_path(estimate[:, :3, 3], delta)
        if over_path
        else metrics.pairs_over_frames(len(truth), int(delta))
    )
    ours = metrics.relative_error(estimate, truth, pairs)
    assert ours.pairs > 100
    for relation, statistics in (
        ("translation_part", ours.translation_m),
        ("rotation_angle_deg", ours.rotation_deg),
    ):
        rpe = evo.metrics.RPE(evo.relation[relation], delta, evo.metrics.Unit[unit], all_pairs=True)
        rpe.process_data((evo.path(truth), evo.path(estimate)))
        _assert_same(statistics, rpe)


class _Evo:
    """evo, where it is installed."""

    def __init__(self) -> None:
        self.metrics: Any = importlib.import_module("evo.core.metrics")
        self.relation: Any = self.metrics.PoseRelation
        self._trajectory: Any = importlib.import_module("evo.core.trajectory")

    def path(self, T_world_camera: Array) -> Any:
        return self._trajectory.PosePath3D(poses_se3=list(T_world_camera))


def _evo() -> _Evo:
    pytest.importorskip("evo")
    return _Evo()


def _assert_same(ours: metrics.Statistics, theirs: Any) -> None:
    for name, value in vars(ours).items():
        assert value == pytest.approx(theirs.get_all_statistics()[name], abs=1e-6), name


def _at(positions: Any) -> Array:
    return se3.make(np.eye(3), np.array(positions, float))


def test_relocalisation_counts_shares_of_all_photos_and_wrong_answers() -> None:
    off_m, off_deg = [0.01, 0.08, 0.04, 0.2, 0.31, 0.02], [1.0, 1.0, 4.0, 9.0, 1.0, 11.0]
    found = metrics.Relocalisation.of(off_m, off_deg, photos=10)
    assert (found.photos, found.located, found.wrong) == (10, 6, 2)
    # 5 cm, 5 deg: the first and third; 10 cm, 3 deg: the first two; 25 cm, 10 deg: the first four
    assert found.within == (0.2, 0.2, 0.4)
    assert found.median_m == pytest.approx(0.06)
    assert found.median_deg == pytest.approx(2.5)


def test_relocalisation_of_photos_of_which_none_is_located_has_no_median() -> None:
    found = metrics.Relocalisation.of([], [], photos=3)
    assert found.within == (0.0, 0.0, 0.0)
    assert found.wrong == 0
    assert np.isnan(found.median_m)
