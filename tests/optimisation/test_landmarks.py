"""Landmarks of keyframes that go past a wall of points, with the noise of the settings."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from vnav.config import OptimiseConfig, RegistrationConfig
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.frame import Edge, Features
from vnav.core.mapping import FrameFeatures
from vnav.features.sift import SPACE
from vnav.optimisation.bundle_problem import PosePrior
from vnav.optimisation.feature_tracks import FeatureTracks, merged
from vnav.optimisation.landmarks import AdjustedBundle, rough_bundle
from vnav.optimisation.sensor_model import SensorModel

CAMERA = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
NOISE = RegistrationConfig()
CONFIG = OptimiseConfig()
KEYFRAMES, SHARED, ALONE = 5, 80, 10
HELD = np.diag(np.repeat([0.01, 0.03], 3) ** -2.0)  # rad, m


@dataclass
class Scene:
    """Every keyframe sees all shared points, then some that it alone sees."""

    T: np.ndarray
    points: np.ndarray
    keyframes: list[FrameFeatures]
    matches: np.ndarray

    def adjusted(
        self,
        start: np.ndarray,
        matches: np.ndarray | None = None,
        prior: PosePrior | None = None,
        config: OptimiseConfig = CONFIG,
    ) -> AdjustedBundle:
        tracks = tracked(self.keyframes, self.matches if matches is None else matches)
        model = SensorModel([CAMERA] * len(self.keyframes), NOISE)
        return rough_bundle(start, tracks, joined(start), model, config, prior).adjusted()


def tracked(keyframes: list[FrameFeatures], matches: np.ndarray) -> FeatureTracks:
    return FeatureTracks(keyframes, merged(keyframes, matches))


def joined(T: np.ndarray) -> list[Edge]:
    """Every keyframe to the next, as the poses say."""
    known = np.isfinite(T[:, 0, 0])
    return [
        Edge(k, k + 1, se3.inverse(T[k]) @ T[k + 1], HELD)
        for k in range(len(T) - 1)
        if known[k : k + 2].all()
    ]


def scene(seed: int, noise: float = 1.0, offset: float = 0.0) -> Scene:
    """With that share of the settings' noise, and that much too much in every inverse depth."""
    rng = np.random.default_rng(seed)
    xi = np.zeros((KEYFRAMES, 6))
    xi[:, 1], xi[:, 3] = np.linspace(0, -0.2, KEYFRAMES), np.linspace(0, 0.8, KEYFRAMES)
    T = se3.exp(xi)
    points = rng.uniform([-0.6, -0.6, 2], [1.0, 0.6, 4], (SHARED, 3))
    alone = rng.uniform([-0.3, -0.3, 1], [0.3, 0.3, 4], (KEYFRAMES, ALONE, 3))
    seen = np.concatenate([se3.transform(se3.inverse(T), points), alone], 1)
    keyframes = [measured(k, p, rng, noise, offset) for k, p in enumerate(seen)]
    pairs = [(i, j) for i in range(KEYFRAMES) for j in range(i + 1, min(i + 3, KEYFRAMES))]
    matches = [(i, n, j, n) for i, j in pairs for n in range(SHARED)]
    return Scene(T, points, keyframes, np.array(matches, np.int32))


def measured(
    row: int, points: np.ndarray, rng: np.random.Generator, noise: float, offset: float
) -> FrameFeatures:
    n = len(points)
    px = CAMERA.project(points) + noise * NOISE.pixel_sigma_px * rng.standard_normal((n, 2))
    inverse = 1 / points[:, 2] + noise * NOISE.depth_sigma_per_m2 * rng.standard_normal(n)
    inverse += offset
    features = Features(
        px, np.zeros((n, 128), np.uint8), np.ones(n), np.ones(n), np.zeros(n), SPACE
    )
    return FrameFeatures(row, features, CAMERA.unproject(features.keypoints_px, 1 / inverse))


def changed(
    keyframe: FrameFeatures, rows: np.ndarray, shift_px: float, depth: bool = True
) -> FrameFeatures:
    """The keyframe with some keypoints put elsewhere, or without their depth."""
    px, points = keyframe.features.keypoints_px.copy(), keyframe.points_camera.copy()
    px[rows] += shift_px
    points[rows] = CAMERA.unproject(px[rows], points[rows, 2]) if depth else np.nan
    old = keyframe.features
    features = replace(old, keypoints_px=px)
    return FrameFeatures(keyframe.row, features, points)


def disturbed(T: np.ndarray, seed: int = 0) -> np.ndarray:
    """As a pose graph leaves poses: a quarter of a degree and 1 cm off."""
    xi = np.repeat([0.005, 0.01], 3) * np.random.default_rng(seed).standard_normal((len(T), 6))
    xi[0] = 0
    return T @ se3.exp(xi)


def observed(result: AdjustedBundle) -> set[tuple[int, int]]:
    """FrameFeatures and feature of every observation."""
    landmarks = result.landmarks
    return set(zip(landmarks.keyframe.tolist(), landmarks.feature.tolist(), strict=True))


def test_poses_come_back_within_their_covariance() -> None:
    made = scene(0)
    result = made.adjusted(disturbed(made.T))
    error = se3.inverse(made.T) @ result.T_world_camera
    xi = np.concatenate([se3.log_so3(error[:, :3, :3]), error[:, :3, 3]], 1)
    for x, c in zip(xi[1:], result.covariance[1:], strict=True):
        assert x @ np.linalg.solve(c, x) < 24  # chi-squared of 6: once in 2000
    assert result.rms_px_after < result.rms_px_before


def test_landmarks_lie_where_the_points_are() -> None:
    # Points err by their sigma given the poses, and by the poses' errors, which are smaller.
    made = scene(1)
    result = made.adjusted(disturbed(made.T))
    landmarks = result.landmarks
    nearest = np.linalg.norm(landmarks.points_world[:, None] - made.points, axis=2)
    off = nearest.min(1) / (np.sqrt(3) * landmarks.sigma_m)
    assert np.median(off[np.bincount(landmarks.landmark) > 1]) < 1.5


def test_fixed_poses_stay_and_landmarks_are_adjusted_to_them() -> None:
    made = scene(1)
    result = made.adjusted(made.T, prior=PosePrior(made.T, np.zeros(6), fixed=True))
    np.testing.assert_array_equal(result.T_world_camera, made.T)
    np.testing.assert_array_equal(result.covariance, np.zeros((KEYFRAMES, 6, 6)))
    # Of SHARED points with noise of their own; better than the mean of their depths alone.
    landmarks = result.landmarks
    shared = np.bincount(landmarks.landmark) > 1
    off = np.linalg.norm(landmarks.points_world[shared][:, None] - made.points, axis=2).min(1)
    assert np.median(off / (np.sqrt(3) * landmarks.sigma_m[shared])) < 1
    assert result.rms_px_after < result.rms_px_before


def test_matched_features_are_one_landmark_and_the_others_one_each() -> None:
    made = scene(2)
    landmarks = made.adjusted(disturbed(made.T)).landmarks
    counts = np.bincount(landmarks.landmark)
    # 0.1 % of right observations are taken for outliers: of 400, hardly more than three.
    assert (counts == KEYFRAMES).sum() >= SHARED - 3
    assert (counts == 1).sum() >= KEYFRAMES * ALONE
    assert len(landmarks) == len(counts)
    assert counts.min() > 0


def test_observations_are_sorted_by_landmark_then_keyframe() -> None:
    made = scene(2)
    landmarks = made.adjusted(disturbed(made.T)).landmarks
    rows = list(zip(landmarks.landmark.tolist(), landmarks.keyframe.tolist(), strict=True))
    assert rows == sorted(set(rows))


def test_outlying_observations_are_dropped_and_the_others_kept() -> None:
    made = scene(3)
    bad = np.arange(0, SHARED, 8)
    made.keyframes[2] = changed(made.keyframes[2], bad, shift_px=30)
    result = made.adjusted(disturbed(made.T))
    assert not observed(result) & {(2, int(n)) for n in bad}
    expected = {(k, n) for k in range(KEYFRAMES) for n in range(SHARED)}
    expected -= {(2, int(n)) for n in bad}
    # What the outlier at first pulls its landmark away from may go with it: one in forty.
    assert len(expected - observed(result)) <= 10


def test_two_points_matched_as_one_do_not_make_one_landmark() -> None:
    # Features of keyframes 0 and 1 see point 0, those of 2 to 4 point 1, half a metre away.
    made = scene(4)
    made.points[1] = made.points[0] + [0.5, 0, 0]
    matches = made.matches[(made.matches[:, 1] > 1)]
    wrong = [(0, 0, 1, 0), (1, 0, 2, 1), (2, 1, 3, 1), (3, 1, 4, 1)]
    result = made.adjusted(disturbed(made.T), np.concatenate([matches, np.array(wrong)]))
    landmarks = result.landmarks
    of_point = {
        (k, f): n
        for n, k, f in zip(landmarks.landmark, landmarks.keyframe, landmarks.feature, strict=True)
    }
    assert of_point.get((1, 0)) is None or of_point[1, 0] != of_point.get((2, 1))


def test_a_landmark_seen_once_stays_where_its_keyframe_sees_it() -> None:
    made = scene(5)
    result = made.adjusted(disturbed(made.T))
    landmarks = result.landmarks
    once = (np.bincount(landmarks.landmark) == 1)[landmarks.landmark]
    assert once.sum() >= KEYFRAMES * ALONE
    T_camera_world = se3.inverse(result.T_world_camera)[landmarks.keyframe[once]]
    points = landmarks.points_world[landmarks.landmark[once]]
    seen = se3.transform(T_camera_world, points[:, None])[:, 0]
    lifted = np.stack(
        [
            made.keyframes[k].points_camera[f]
            for k, f in zip(landmarks.keyframe[once], landmarks.feature[once], strict=True)
        ]
    )
    expected = lifted / (1 - result.sensor.errors[0].depth_offset * lifted[:, 2:])
    np.testing.assert_allclose(seen, expected, atol=2e-6)  # float32 at 4 m, twice


def test_a_feature_without_depth_that_nothing_else_sees_is_no_landmark() -> None:
    made = scene(6)
    blind = np.arange(SHARED, SHARED + ALONE)
    made.keyframes[1] = changed(made.keyframes[1], blind, 0, depth=False)
    assert not observed(made.adjusted(disturbed(made.T))) & {(1, int(n)) for n in blind}


def test_a_feature_without_depth_observes_a_landmark_that_others_fix() -> None:
    made = scene(7)
    blind = np.arange(0, SHARED, 2)
    made.keyframes[1] = changed(made.keyframes[1], blind, 0, depth=False)
    kept = observed(made.adjusted(disturbed(made.T))) & {(1, int(n)) for n in blind}
    assert len(kept) >= len(blind) - 2


def without_depth(made: Scene, tracks: np.ndarray) -> Scene:
    """The scene with tracks (M,) that no keyframe has the depth of."""
    blind = [changed(keyframe, tracks, 0, depth=False) for keyframe in made.keyframes]
    return replace(made, keyframes=blind)


def test_a_track_without_depth_is_a_landmark_where_its_rays_meet() -> None:
    """Seen from 0.8 m, 2 to 4 m away: it is as exact as its standard deviation says."""
    blind = np.arange(0, SHARED, 4)
    made = without_depth(scene(8), blind)
    result = made.adjusted(disturbed(made.T))
    first = result.landmarks.keyframe == 0
    feature = result.landmarks.feature[first]
    rows = result.landmarks.landmark[first][np.isin(feature, blind)]
    assert len(rows) >= len(blind) - 2
    true = made.points[feature[np.isin(feature, blind)]]
    off = np.linalg.norm(result.landmarks.points_world[rows] - true, axis=1)
    assert np.sqrt(((off / result.landmarks.sigma_m[rows]) ** 2).mean() / 3) < 1.5


def test_a_track_without_depth_that_two_keyframes_see_is_no_landmark() -> None:
    made = without_depth(scene(8), np.array([3]))
    of_two = ~((made.matches[:, 1] == 3) & (made.matches[:, [0, 2]] != [0, 1]).any(1))
    result = made.adjusted(disturbed(made.T), made.matches[of_two])
    assert not observed(result) & {(k, 3) for k in range(KEYFRAMES)}


def test_a_track_without_depth_that_has_no_parallax_is_no_landmark() -> None:
    """A thousandth of the baseline at 3 m: nobody knows how far away it is."""
    made = without_depth(scene(8), np.arange(SHARED))
    narrow = made.T.copy()
    narrow[:, :3] = np.eye(4)[:3]
    narrow[:, 0, 3] = 0.001 * np.arange(KEYFRAMES)
    rng = np.random.default_rng(0)
    seen = [se3.transform(se3.inverse(T), made.points) for T in narrow]
    keyframes = [measured(k, p, rng, 1.0, 0.0) for k, p in enumerate(seen)]
    made = without_depth(replace(made, T=narrow, keyframes=keyframes), np.arange(SHARED))
    tracks = tracked(made.keyframes, made.matches)
    model = SensorModel([CAMERA] * KEYFRAMES, NOISE)
    rows = np.arange(len(tracks.seen))
    assert np.isnan(tracks.met(narrow, rows, model)).all()


def test_tracks_without_depth_tell_how_keyframes_turned() -> None:
    """Of 80 tracks 70 are without depth; with them poses turn out better than by the ten alone."""
    squared = np.zeros((2, 10))
    for k, seed in np.ndindex(squared.shape):
        made = without_depth(scene(seed), np.arange(10, SHARED))
        kept = made.matches[made.matches[:, 1] < 10] if k else made.matches
        poses = made.adjusted(disturbed(made.T, seed), kept).T_world_camera
        off = [se3.deviation(se3.inverse(T) @ U) for T, U in zip(made.T, poses, strict=True)]
        squared[k, seed] = np.square(off)[:, :3].mean()
    with_them, without = np.sqrt(squared.mean(1))
    assert with_them < 0.8 * without


def test_a_keyframe_without_a_pose_takes_no_part() -> None:
    made = scene(9)
    start = disturbed(made.T)
    start[4] = np.nan
    result = made.adjusted(start)
    assert 4 not in result.landmarks.keyframe
    assert np.isnan(result.T_world_camera[4]).all()
    assert np.isnan(result.covariance[4]).all()
    assert np.isfinite(result.landmarks.points_world).all()
    assert np.isfinite(result.T_world_camera[:4]).all()


def test_a_keyframe_that_shares_nothing_is_held_by_its_given_motion() -> None:
    made = scene(10)
    start = disturbed(made.T)
    matches = made.matches[(made.matches[:, [0, 2]] != 4).all(1)]
    result = made.adjusted(start, matches)
    given = se3.inverse(start[3]) @ start[4]
    np.testing.assert_allclose(
        se3.inverse(result.T_world_camera[3]) @ result.T_world_camera[4], given, atol=1e-6
    )
    assert np.isfinite(result.covariance).all()
    # A held keyframe is less certain than one that sees what the others see.
    assert np.trace(result.covariance[4]) > 10 * np.trace(result.covariance[3])


def test_one_keyframe_alone_has_landmarks_from_its_depth() -> None:
    made = scene(11)
    only = Scene(made.T[:1], made.points, made.keyframes[:1], np.zeros((0, 4), np.int32))
    tracks = tracked(only.keyframes, only.matches)
    result = rough_bundle(only.T, tracks, [], SensorModel([CAMERA], NOISE), CONFIG).adjusted()
    np.testing.assert_array_equal(result.T_world_camera, only.T)
    assert len(result.landmarks) == SHARED + ALONE
    np.testing.assert_allclose(
        result.landmarks.points_world, only.keyframes[0].points_camera, atol=1e-6
    )


def test_the_same_keyframes_give_the_same_landmarks() -> None:
    made = scene(12)
    first, second = (made.adjusted(disturbed(made.T)) for _ in range(2))
    assert first.landmarks.points_world.tobytes() == second.landmarks.points_world.tobytes()
    assert first.T_world_camera.tobytes() == second.T_world_camera.tobytes()


@pytest.mark.parametrize("rounds", [1, 3])
def test_rounds_are_set_by_the_configuration(rounds: int) -> None:
    made = scene(13)
    tracks = tracked(made.keyframes, made.matches)
    model = SensorModel([CAMERA] * KEYFRAMES, NOISE)
    config = OptimiseConfig(bundle_rounds=rounds)
    start = disturbed(made.T)
    result = rough_bundle(start, tracks, joined(start), model, config).adjusted()
    # 3 numbers an observation, of which points and poses take up a quarter: sqrt(2 * 0.75) px.
    assert result.rms_px_after == pytest.approx(1.22, rel=0.1)


def test_depth_that_is_too_short_far_away_is_allowed_for() -> None:
    # 1 to 5 mm at 2 to 4 m. The least noise that is believed, 0.1 px and 1e-4 1/m, tells it as well
    # as the prior does, where 400 observations have nothing in common. With 1.2e-5 1/m in common
    # its variance is 1 + 400 * 0.12^2 = 6.8 times that, so an eighth of it is found.
    offset = 3e-4
    result = scene(14, noise=0.02, offset=offset).adjusted(disturbed(scene(14).T))
    assert result.sensor.errors[0].depth_offset == pytest.approx(offset / 8, rel=0.5)


def test_one_round_allows_for_nothing() -> None:
    made = scene(14, noise=0.02, offset=3e-4)
    tracks, model = (
        tracked(made.keyframes, made.matches),
        SensorModel([CAMERA] * KEYFRAMES, NOISE),
    )
    start = disturbed(made.T)
    config = OptimiseConfig(bundle_rounds=1)
    assert (
        rough_bundle(start, tracks, joined(start), model, config).sensor.errors[0].depth_offset == 0
    )


def test_without_rounds_the_poses_stay_and_landmarks_are_where_depth_has_them() -> None:
    """Poses 5 mm off put a landmark off by as much, and by the depth noise of its sightings.

    That is 1.4 mm/m2 at 2 to 4 m, so 22 mm at most from one of them, and less from five.
    """
    made = scene(0)
    start = made.T.copy()
    start[1:, 0, 3] += 0.005
    found = made.adjusted(start, config=replace(CONFIG, bundle_rounds=0))
    np.testing.assert_array_equal(found.T_world_camera, start)
    assert found.rms_px_before == found.rms_px_after
    assert len(found.landmarks) == SHARED + KEYFRAMES * ALONE
    away = np.linalg.norm(found.landmarks.points_world[:, None] - made.points, axis=2).min(1)
    assert np.sort(away)[:SHARED].max() < 0.005 + 3 * 0.022
    assert np.isfinite(found.covariance[1:]).all()


def test_without_rounds_a_landmark_that_only_views_without_depth_agree_on_is_none() -> None:
    """Two views with depth see it 50 px to either side: their mean is right, and neither agrees."""
    made, first = scene(0), np.array([0])
    for k, shift_px in enumerate((50.0, -50.0)):
        made.keyframes[k] = changed(made.keyframes[k], first, shift_px)
    for k in range(2, KEYFRAMES):
        made.keyframes[k] = changed(made.keyframes[k], first, 0.0, depth=False)
    found = made.adjusted(made.T, config=replace(CONFIG, bundle_rounds=0))
    assert np.isfinite(found.landmarks.points_world).all()
    assert len(found.landmarks) == SHARED - 1 + KEYFRAMES * ALONE
