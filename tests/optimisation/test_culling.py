"""A wall of points that a camera goes past again and again."""

from dataclasses import replace

import numpy as np
import pytest

from vnav.config import Config
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.frame import Edge, Features
from vnav.core.mapping import FrameFeatures, FrameTable, Odometry, OptimisedMap, World
from vnav.evaluation.metrics import absolute_error
from vnav.features.sift import SPACE
from vnav.optimisation.culling import OTHERS, needed_keyframes
from vnav.optimisation.feature_tracks import merged
from vnav.optimisation.solution import Solution, solve
from vnav.optimisation.solution_report import solution_report

CAMERA = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
PLACES, WAYS, POINTS = 6, 10, 120
SIGMAS = np.repeat([0.0005, 0.001], 3)  # rad, m: of edges
CONFIG = Config()


def poses() -> np.ndarray:
    """``T_world_camera`` (WAYS * PLACES, 4, 4): there and back, each place once a way."""
    xi = np.zeros((PLACES, 6))
    xi[:, 1], xi[:, 3] = np.linspace(0, -0.3, PLACES), np.linspace(0, 1.5, PLACES)
    there = se3.exp(xi)
    return np.concatenate([there if k % 2 == 0 else there[::-1] for k in range(WAYS)])


def edge(T: np.ndarray, i: int, j: int, rng: np.random.Generator) -> Edge:
    """The motion between two frames, with noise."""
    T_i_j = se3.inverse(T[i]) @ T[j] @ se3.exp(SIGMAS * rng.standard_normal(6))
    return Edge(i, j, T_i_j, np.diag(SIGMAS**-2))


def seen(row: int, points: np.ndarray, rng: np.random.Generator) -> FrameFeatures:
    """All points of the wall as a keyframe measures them, in the order of their numbers."""
    noise = CONFIG.registration
    px = CAMERA.project(points) + noise.pixel_sigma_px * rng.standard_normal((len(points), 2))
    inverse = 1 / points[:, 2] + noise.depth_sigma_per_m2 * rng.standard_normal(len(points))
    ones, none = np.ones(len(points)), np.zeros((len(points), 128), np.uint8)
    features = Features(px, none, ones, ones, 0 * ones, SPACE)
    return FrameFeatures(row, features, CAMERA.unproject(features.keypoints_px, 1 / inverse))


def walked(seed: int) -> tuple[Odometry, list[Edge], np.ndarray]:
    """Odometry, closures with the way before, and the matches of both."""
    rng, T = np.random.default_rng(seed), poses()
    points = rng.uniform([-0.5, -0.6, 2.5], [1.8, 0.6, 3.5], (POINTS, 3))
    keyframes = [seen(k, se3.transform(se3.inverse(P), points), rng) for k, P in enumerate(T)]
    edges = [edge(T, k, k + 1, rng) for k in range(len(T) - 1)]
    chained = [np.eye(4)]
    for e in edges:
        chained.append(chained[-1] @ e.T_i_j)
    again = [(w * PLACES - 1 - p, w * PLACES + p) for w in range(1, WAYS) for p in range(PLACES)]
    closures = [edge(T, i, j, rng) for i, j in again]
    pairs = [*again, *((k, k + 1) for k in range(len(T) - 1))]
    matches = [(i, n, j, n) for i, j in pairs for n in range(POINTS)]
    rows = np.arange(len(T), dtype=np.int32)
    frames = FrameTable(0 * rows, rows, rows / 10)
    reasons = ("",) * len(T)
    odometry = Odometry(
        frames, np.array(chained), 0 * rows, reasons, tuple(edges), tuple(keyframes)
    )
    neighbours = [edge(T, k, k + 1, rng) for k in range(len(T) - 1)]
    return odometry, [*closures, *neighbours], np.array(matches, np.int32)


def solved(seed: int, most: int) -> Solution:
    """The map of a walk, by at most so many keyframes where others can be left out."""
    odometry, closures, matches = walked(seed)
    config = replace(CONFIG, optimise=replace(CONFIG.optimise, max_keyframes=most))
    return solve(odometry, closures, matches, [CAMERA], config)


def off_m(found: Solution) -> float:
    """ATE, root mean square, of all frames."""
    return absolute_error(found.poses, poses()).translation_m.rmse


def test_so_many_keyframes_as_are_allowed_are_all_needed() -> None:
    odometry, _, matches = walked(0)
    count = len(odometry.keyframes)
    assert len(needed_keyframes(merged(odometry.keyframes, matches), count)) == count


def test_of_keyframes_that_all_see_the_same_enough_are_left() -> None:
    odometry, _, matches = walked(0)
    assert len(needed_keyframes(merged(odometry.keyframes, matches), 1)) == OTHERS


def test_no_more_are_left_out_than_must_be() -> None:
    odometry, _, matches = walked(0)
    assert len(needed_keyframes(merged(odometry.keyframes, matches), 40)) == 40


def test_a_keyframe_that_sees_what_few_others_see_is_needed() -> None:
    """Half of what the last two share nobody else sees."""
    odometry, _, matches = walked(0)
    last = len(odometry.keyframes) - 1
    apart = (matches[:, 2] >= last - 1) & (matches[:, 0] < last - 1) & (matches[:, 1] % 2 == 0)
    assert {last - 1, last} <= set(needed_keyframes(merged(odometry.keyframes, matches[~apart]), 1))


def test_a_keyframe_that_shares_nothing_is_needed() -> None:
    odometry, _, matches = walked(0)
    apart = (matches[:, [0, 2]] == 7).any(1)
    assert 7 in needed_keyframes(merged(odometry.keyframes, matches[~apart]), 1)


@pytest.mark.parametrize("seed", range(3))
def test_frames_that_are_left_out_follow_the_others(seed: int) -> None:
    """Each hangs by two edges and its loops, whose noise is that of the edges."""
    all_of_them, few = solved(seed, 1000), solved(seed, 1)
    assert np.isfinite(few.poses).all()
    assert off_m(few) < off_m(all_of_them) + np.sqrt(3) * SIGMAS[3]


def test_the_report_says_how_many_are_left_out() -> None:
    odometry, found = walked(0)[0], solved(0, 1)
    adjusted, world = found.adjusted, World("floor", 9, 0.01)
    on_time = np.zeros(len(found.poses))
    result = OptimisedMap(found.poses, adjusted.covariance, adjusted.landmarks, world, on_time)
    report = solution_report(found, result, odometry)
    assert report.values["keyframes_culled"] == WAYS * PLACES - OTHERS
    left_out = f"{WAYS * PLACES - OTHERS} of 60 keyframes are left out of it"
    assert f"{left_out}: others see what they see" in report.lines


def test_what_is_left_out_has_no_landmark_and_no_covariance() -> None:
    adjusted = solved(0, 1).adjusted
    left_out = np.isnan(adjusted.T_world_camera[:, 0, 0])
    assert 0 < (~left_out).sum() < WAYS * PLACES / 2
    assert not left_out[adjusted.landmarks.keyframe].any()
    np.testing.assert_array_equal(np.isnan(adjusted.covariance[:, 0, 0]), left_out)


def test_a_landmark_that_only_keyframes_left_out_join_stays_one() -> None:
    """Every keyframe matches the next alone, so that hardly two that are left match each other."""
    odometry, closures, matches = walked(0)
    in_time = matches[:, 2] == matches[:, 0] + 1
    config = replace(CONFIG, optimise=replace(CONFIG.optimise, max_keyframes=1))
    found = solve(odometry, closures, matches[in_time], [CAMERA], config)
    kept = np.isfinite(found.adjusted.T_world_camera[:, 0, 0]).sum()
    assert kept < WAYS * PLACES / 2
    sightings = np.bincount(found.adjusted.landmarks.landmark)
    assert len(sightings) < 1.1 * POINTS
    assert np.median(sightings) > 0.9 * kept
