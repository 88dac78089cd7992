"""The tiny capture mapped at its true poses, and at others that do not fit it."""

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.masking.moving_box import CAMERA
from tests.masking.panning_camera import RATE_HZ, frame_at, pose_at
from vnav.config import Config, FeaturesConfig, OptimiseConfig
from vnav.core import se3
from vnav.core.camera_motion import velocities
from vnav.core.frame import Features, Frame
from vnav.core.mapping import LOST, FrameFeatures, FrameTable, Odometry, OptimisedMap
from vnav.core.reduced_frame import BLOCK_PX
from vnav.core.trajectory import Trajectory
from vnav.errors import CaptureError, ConfigError, TrajectoryError
from vnav.features.sift import SPACE
from vnav.io.formats.trajectories import read_tum
from vnav.io.sources.capture import Capture
from vnav.io.store.artifacts import (
    load_loop_edges,
    load_loops,
    load_odometry,
    load_optimised,
    save_loops,
    save_odometry,
)
from vnav.io.store.map_folder import MapFolder
from vnav.masking.depth_delay import DepthDelay
from vnav.stages import loops, optimise, vocabulary
from vnav.stages import odometry as odometry_stage
from vnav.synthetic import MINIATURE, one_room
from vnav.tracking.given_poses import NO_POSE, GivenPoses, poses_at

FULL_SIZE = CAMERA.scaled(BLOCK_PX * CAMERA.width, BLOCK_PX * CAMERA.height)
SHAPE = FULL_SIZE.height, FULL_SIZE.width
NO_IMAGES = np.zeros((*SHAPE, 3), np.uint8), np.zeros(SHAPE, np.float32)
SECONDS = 4.0
CONFIG = Config(features=FeaturesConfig(max_features=500))  # a third: quick
NOISE = np.repeat([0.015, 0.03], 3)  # rad, m
WITHOUT = 7  # the frame whose pose is left out


@pytest.fixture(scope="module")
def truth(tiny_capture: Path) -> Trajectory:
    return read_tum(tiny_capture / "groundtruth.txt")


@pytest.fixture(scope="module")
def folder(
    capture: Capture, truth: Trajectory, tmp_path_factory: pytest.TempPathFactory
) -> MapFolder:
    """A map at the true poses but one, up to optimise."""
    folder = MapFolder.create(tmp_path_factory.mktemp("maps") / "given")
    odometry_stage.run(folder, capture, CONFIG, given=without(truth, WITHOUT))
    for stage in (vocabulary, loops, optimise):
        stage.run(folder, CONFIG)
    return folder


@pytest.fixture(scope="module")
def result(folder: MapFolder) -> OptimisedMap:
    return load_optimised(folder)


class First:
    """The first four frames of a capture, of which one may be black and one unreadable."""

    name, has_depth, poses = "first", True, None

    def __init__(self, whole: Capture, black: int = -1, unreadable: int = -1) -> None:
        self._whole, self._black, self._unreadable = whole, black, unreadable
        self.camera, self.stamps_s = whole.camera, whole.stamps_s[:4]
        self.fingerprint = whole.fingerprint

    def __len__(self) -> int:
        return 4

    def read(self, index: int) -> Frame:
        if index == self._unreadable:
            raise CaptureError("expected a whole image, found a truncated file")
        frame = self._whole.read(index)
        black = np.zeros_like(frame.color)
        return dataclasses.replace(frame, color=black) if index == self._black else frame


def without(trajectory: Trajectory, *rows: int) -> Trajectory:
    stamps_s = np.delete(trajectory.stamps_s, rows)
    return Trajectory(stamps_s, np.delete(trajectory.T_world_camera, rows, 0))


def remade(folder: MapFolder, changed: Odometry, root: Path) -> MapFolder:
    """A map with other odometry and the same loops."""
    other = MapFolder.create(root)
    other.set_captures(folder.captures)
    with other.writing("odometry", {}, {}) as draft:
        save_odometry(draft, changed)
        shutil.copytree(folder.root / "odometry" / "keyframes", draft / "keyframes")
    with other.writing("loops", {}, other.inputs_of("odometry")) as draft:
        save_loops(draft, load_loops(folder, "loops"), *load_loop_edges(folder))
    return other


def test_a_frame_has_the_pose_that_is_nearest_in_time_and_near_enough() -> None:
    poses = se3.make(np.tile(np.eye(3), (3, 1, 1)), [[1, 0, 0], [2, 0, 0], [3, 0, 0]])
    given = Trajectory(np.array([0.0, 1.0, 2.0]), poses)
    T = poses_at(np.array([2.01, 0.5, 0.985, 0.991]), given, 0.02)
    np.testing.assert_array_equal(T[[0, 3], 0, 3], [3, 2])
    assert np.isnan(T[[1, 2]]).all()  # the third frame's pose is nearer to the fourth


@pytest.mark.parametrize(("shift_s", "poses"), [(100.0, 40), (0.0, 0)])
def test_poses_of_another_clock_are_refused_with_both_times(shift_s: float, poses: int) -> None:
    given = Trajectory(shift_s + np.arange(poses), np.tile(np.eye(4), (poses, 1, 1)))
    times = "poses from 100.000 to 139.000 s" if poses else "poses from no time at all"
    expected = f"for 0 of 50: frames are from 0.000 to 49.000 s, {times}"
    with pytest.raises(TrajectoryError, match=expected):
        poses_at(np.arange(50.0), given, 0.02)


def test_a_pose_that_no_camera_can_have_reached_is_named(truth: Trajectory) -> None:
    poses = truth.T_world_camera.copy()
    poses[20, 0, 3] += 1000
    given = Trajectory(truth.stamps_s, poses)
    where = f"between those at {truth.stamps_s[19]:.6f} and {truth.stamps_s[20]:.6f} s"
    with pytest.raises(TrajectoryError, match=rf"found (999|1000)\.\d m {where}"):
        poses_at(truth.stamps_s, given, 0.02)


def test_every_pose_is_the_one_given(result: OptimisedMap, truth: Trajectory) -> None:
    known = np.arange(60) != WITHOUT
    np.testing.assert_array_equal(result.T_world_camera[known], truth.T_world_camera[known])


def test_a_frame_without_a_pose_is_named(odometry: Odometry, result: OptimisedMap) -> None:
    assert odometry.segment[WITHOUT] == LOST
    assert [row for row, reason in enumerate(odometry.reasons) if reason] == [WITHOUT]
    assert odometry.reasons[WITHOUT] == NO_POSE
    assert np.isnan(result.T_world_camera[WITHOUT]).all()


def test_keyframes_at_given_poses_are_fewer_than_frames_and_never_far_apart(
    odometry: Odometry, truth: Trajectory
) -> None:
    rows = np.array([k.row for k in odometry.keyframes])
    assert 10 <= len(rows) <= 30
    T = truth.T_world_camera
    motion = se3.inverse(T[rows[:-1]]) @ T[rows[1:]]
    step = se3.inverse(T[:-2]) @ T[2:]  # two: over the frame that is left out
    step_m = np.linalg.norm(step[:, :3, 3], axis=1).max()
    far_m = CONFIG.odometry.keyframe_translation_m + step_m
    assert np.linalg.norm(motion[:, :3, 3], axis=1).max() < far_m
    far_rad = np.deg2rad(CONFIG.odometry.keyframe_rotation_deg) + se3.rotation_angle(step).max()
    assert se3.rotation_angle(motion).max() < far_rad


def test_given_poses_are_certain(result: OptimisedMap, odometry: Odometry) -> None:
    assert result.keyframe_covariance.shape == (len(odometry.keyframes), 6, 6)
    assert not result.keyframe_covariance.any()


def with_noise(odometry: Odometry, sigmas: np.ndarray) -> Odometry:
    """Each pose off on its own."""
    xi = sigmas * np.random.default_rng(0).standard_normal((len(odometry.frames), 6))
    return dataclasses.replace(odometry, T_segment_camera=odometry.T_segment_camera @ se3.exp(xi))


@pytest.fixture(scope="module")
def noisy(
    folder: MapFolder, odometry: Odometry, tmp_path_factory: pytest.TempPathFactory
) -> MapFolder:
    """The map with poses that are off by more than a closure's noise."""
    root = tmp_path_factory.mktemp("maps") / "noisy"
    return remade(folder, with_noise(odometry, NOISE), root)


def test_noise_of_given_poses_is_measured_and_said(noisy: MapFolder, odometry: Odometry) -> None:
    report = optimise.run(noisy, CONFIG)
    result = load_optimised(noisy)
    poses = load_odometry(noisy).T_segment_camera
    np.testing.assert_array_equal(result.T_world_camera, poses)
    # From the median over pairs of a score of keyframes: within a third; the closures' own noise
    # is in it and is a half of that put in at most.
    sigmas = np.sqrt(np.diagonal(result.keyframe_covariance, axis1=1, axis2=2))
    assert (sigmas == sigmas[0]).all()
    assert ((sigmas[0] > NOISE * 0.67) & (sigmas[0] < NOISE * 1.5)).all()
    assert report.values["given_sigma_m"] == pytest.approx(sigmas[0, 3])
    assert any("given poses fixed: loops show noise of" in line for line in report.lines)


def test_poses_that_are_a_prior_are_adjusted_towards_the_truth(
    noisy: MapFolder, odometry: Odometry, truth: Trajectory
) -> None:
    config = Config(CONFIG.seed, optimise=OptimiseConfig(given_poses="prior"))
    optimise.run(noisy, config)
    result = load_optimised(noisy)

    def off_m(poses: np.ndarray) -> float:
        known = np.isfinite(poses[:, 0, 0])
        off = (poses - truth.T_world_camera)[known, :3, 3]
        return float(np.sqrt((off**2).sum(1).mean()))

    given = load_odometry(noisy).T_segment_camera
    # A score of keyframes, each with noise of its own, hold the map together: the mean is left.
    assert off_m(result.T_world_camera) < 0.5 * off_m(given)
    rows = [k.row for k in odometry.keyframes]
    error = se3.inverse(truth.T_world_camera[rows]) @ result.T_world_camera[rows]
    xi = np.concatenate([se3.log_so3(error[:, :3, :3]), error[:, :3, 3]], 1)
    normalised = np.einsum("ki,kij,kj->k", xi, np.linalg.inv(result.keyframe_covariance), xi) / 6
    assert normalised.mean() < 4  # keyframes err together: one draw, not a score


def test_another_word_for_given_poses_is_refused() -> None:
    with pytest.raises(ConfigError, match="given_poses to be fixed or prior, found 'loose'"):
        OptimiseConfig(given_poses="loose")


def test_landmarks_at_given_poses_lie_on_the_surfaces_of_the_room(
    result: OptimisedMap, odometry: Odometry, truth: Trajectory
) -> None:
    # As in test_optimise: nearly all noise is along the ray; 95 % within two standard deviations,
    # less those at edges.
    room, landmarks, off = one_room(MINIATURE.seed), result.landmarks, []
    for k in (1, 6, 11):
        T = truth.T_world_camera[odometry.keyframes[k].row]
        depth = room.render_depth(MINIATURE.camera, T)
        seen = landmarks.landmark[landmarks.keyframe == k]
        in_camera = se3.transform(se3.inverse(T), landmarks.points_world[seen])
        x, y = np.rint(MINIATURE.camera.project(in_camera)).astype(int).T
        inside = (x >= 0) & (x < 320) & (y >= 0) & (y < 240)
        sigma_m = np.sqrt(3) * landmarks.sigma_m[seen][inside]
        off.append((in_camera[inside, 2] - depth[y[inside], x[inside]]) / sigma_m)
    within = np.abs(np.concatenate(off)) < 2
    assert len(within) > 300
    assert within.mean() > 0.9
    assert (np.bincount(landmarks.landmark) > 1).sum() > 500


def test_the_world_is_the_one_given_and_its_floor_is_checked(result: OptimisedMap) -> None:
    # The true world has z up and its floor at zero; the floor is found within millimetres.
    world = result.world
    assert world.source == "given"
    assert world.floor_z_m == pytest.approx(0, abs=0.005)
    assert world.floor_tilt_deg == pytest.approx(0, abs=0.3)
    assert not world.doubt


def test_a_given_world_that_lies_otherwise_is_kept_and_doubted(
    folder: MapFolder, odometry: Odometry, tmp_path: Path
) -> None:
    raised = se3.make(se3.exp_so3([np.deg2rad(10), 0, 0]), [0, 0, 3.0])
    poses = raised @ odometry.T_segment_camera
    other = remade(folder, dataclasses.replace(odometry, T_segment_camera=poses), tmp_path / "map")
    report = optimise.run(other, CONFIG)
    result = load_optimised(other)
    np.testing.assert_array_equal(result.T_world_camera, poses)
    assert result.world.floor_tilt_deg == pytest.approx(10, abs=0.3)
    assert len(report.warnings) == 1
    assert "tilted by 10 deg" in report.warnings[0]


def test_poses_that_contradict_the_images_are_told(
    folder: MapFolder, odometry: Odometry, tmp_path: Path
) -> None:
    poses = se3.inverse(odometry.T_segment_camera)  # world to camera, as some files have it
    other = remade(folder, dataclasses.replace(odometry, T_segment_camera=poses), tmp_path / "map")
    report = optimise.run(other, CONFIG)
    assert any("contradict the images" in warning for warning in report.warnings)


def test_closures_that_agree_are_kept(folder: MapFolder) -> None:
    report = folder.report("optimise")
    assert report["values"]["given_sigma_m"] == 0
    assert report["values"]["closures_kept"] > 20
    assert report["values"]["closures_kept"] > report["values"]["closures_rejected"]
    assert report["warnings"] == []


def test_an_unreadable_frame_is_lost_and_a_black_one_no_keyframe(
    capture: Capture, truth: Trajectory, tmp_path: Path
) -> None:
    found = odometry_stage.track(
        First(capture, black=1, unreadable=2), CONFIG, tmp_path, given=truth
    )
    assert [bool(reason) for reason in found.reasons] == [False, False, True, False]
    assert "truncated" in found.reasons[2]
    np.testing.assert_array_equal(found.T_segment_camera[1], truth.T_world_camera[1])
    assert 1 not in [k.row for k in found.keyframes]
    assert [(e.i, e.j) for e in found.edges] == [(0, 1), (1, 3)]


def test_no_frame_with_features_is_an_error(
    capture: Capture, truth: Trajectory, tmp_path: Path
) -> None:
    few = dataclasses.replace(CONFIG, features=FeaturesConfig(max_features=5))
    with pytest.raises(CaptureError, match="expected frames with a given pose"):
        odometry_stage.track(First(capture), few, tmp_path, given=truth)


def test_the_stage_is_made_anew_for_other_poses(
    capture: Capture, truth: Trajectory, tmp_path: Path
) -> None:
    folder, first = MapFolder.create(tmp_path / "map"), First(capture)
    assert not odometry_stage.run(folder, first, CONFIG, given=truth).reused
    assert odometry_stage.run(folder, first, CONFIG, given=truth).reused
    shifted = Trajectory(truth.stamps_s, se3.make(np.eye(3), [1, 0, 0]) @ truth.T_world_camera)
    assert not odometry_stage.run(folder, first, CONFIG, given=shifted).reused
    assert not odometry_stage.run(folder, first, CONFIG).reused
    assert not load_odometry(folder).given


def share_that_moves(delay_s: float) -> np.ndarray:
    """In each frame of a still room, whose depth is 0.03 s late, at poses that say how late."""
    stamps_s = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    rows, poses = np.arange(len(stamps_s)), np.array([pose_at(s) for s in stamps_s])
    frames = FrameTable(0 * rows, rows, stamps_s)
    builder = GivenPoses(poses, velocities(poses, frames), DepthDelay(delay_s), CONFIG)
    for row, stamp_s in enumerate(stamps_s):
        frame = Frame(0, row, stamp_s, *NO_IMAGES, FULL_SIZE)
        builder.add(seen_in(row), frame, frame_at(stamp_s, 0.03))
    return builder.result(frames).moving_share


def test_what_stands_still_is_not_masked_where_depth_is_known_to_be_late() -> None:
    assert share_that_moves(0.0).max() > 0.1
    assert not share_that_moves(0.03).any()


def seen_in(row: int) -> FrameFeatures:
    """As many features with depth as a keyframe needs, which match nothing."""
    n = CONFIG.registration.min_inliers
    rng = np.random.default_rng(row)
    px = rng.uniform((0, 0), np.subtract(FULL_SIZE.size, 1), (n, 2))
    descriptors = rng.integers(0, 256, (n, SPACE.width), np.uint8)
    found = Features(px, descriptors, *np.ones((3, n)), SPACE)
    return FrameFeatures(row, found, np.c_[rng.uniform(-1, 1, (n, 2)), np.full(n, 2.0)])
