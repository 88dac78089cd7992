"""A camera pans by a furnished room; its frames are registered as a sensor with delays saw them."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from vnav.config import Config, OptimiseConfig, RegistrationConfig
from vnav.core import se3
from vnav.core.frame import Edge, Features, PoseEstimate
from vnav.core.mapping import FrameFeatures, FrameTable, Odometry
from vnav.features.lifting import lift
from vnav.features.sift import SPACE
from vnav.optimisation import solution
from vnav.optimisation.mending import with_edges
from vnav.optimisation.robust_graph import RobustGraph, robust_pose_graph
from vnav.optimisation.sensor_errors import SensorErrors
from vnav.optimisation.solution import Solution, solve
from vnav.registration.correspondences import Correspondences
from vnav.registration.estimators.points3d import Points3dEstimator
from vnav.synthetic import MINIATURE, Scene, one_room
from vnav.synthetic.rendered_capture import camera_poses

CAMERA, CONFIG = MINIATURE.camera, RegistrationConfig()
FRAMES, EVERY, RATE_HZ, POINTS = 49, 4, 30.0, 500
PAN_RAD, PAN_S = 0.25, 1.0  # 1.6 rad/s at most
SPEED_M_PER_S = 0.3
PIXEL_SIGMA = 0.2
TRUE = SensorErrors(0.0, 0.02, 8e-5)


def pose(at_s: np.ndarray) -> np.ndarray:
    """Poses (N, 4, 4) at times: the camera goes sideways and pans from side to side."""
    zero = np.zeros_like(at_s)
    turn = np.stack([zero, PAN_RAD * np.sin(2 * np.pi * at_s / PAN_S), zero], 1)
    start = camera_poses(one_room(0), MINIATURE)[0]
    moved = np.stack([SPEED_M_PER_S * at_s, zero, zero], 1)
    return np.asarray(start @ se3.make(se3.exp_so3(turn), moved))


def seen_px(points: np.ndarray, stamp_s: float) -> np.ndarray:
    """Pixels (P, 2) where the row that sees a point is exposed just then."""
    after_s = np.zeros(len(points))
    for _ in range(12):
        inside = se3.transform(se3.inverse(pose(stamp_s + after_s)), points[:, None])[:, 0]
        px = CAMERA.project(inside)
        after_s = TRUE.line_delay_s * np.nan_to_num(px[:, 1] - (CAMERA.height - 1) / 2)
    return px


def world_points(room: Scene, rng: np.random.Generator) -> np.ndarray:
    """Points (POINTS, 3) that the first, a middle and the last frame see."""
    found = []
    for T in pose(np.linspace(0, (FRAMES - 1) / RATE_HZ, 5)):
        px = rng.integers([15, 15], [CAMERA.width - 15, CAMERA.height - 15], (POINTS // 5, 2))
        z = room.render_depth(CAMERA, T)[px[:, 1], px[:, 0]]
        found.append(se3.transform(T, CAMERA.unproject(px, z)))
    return np.concatenate(found)


@pytest.fixture(scope="module")
def recorded() -> tuple[list[FrameFeatures], list[np.ndarray]]:
    """Every frame's features, one a point, and its depth."""
    room, rng = one_room(0), np.random.default_rng(0)
    points = world_points(room, rng)
    frames, depths = [], []
    for row, stamp_s in enumerate(np.arange(FRAMES) / RATE_HZ):
        px = seen_px(points, stamp_s) + PIXEL_SIGMA * rng.standard_normal((POINTS, 2))
        (T,) = pose(np.array([stamp_s]))
        inside = se3.transform(se3.inverse(T), points)
        still = np.nan_to_num(CAMERA.project(inside)).astype(int)
        x, y = np.clip(still, 0, np.array(CAMERA.size) - 1).T
        hidden = np.abs(room.render_depth(CAMERA, T)[y, x] / inside[:, 2] - 1) > 0.03
        out = ((px < 12) | (px > np.array(CAMERA.size) - 13)).any(1) | ~np.isfinite(px[:, 0])
        (T_depth,) = pose(np.array([stamp_s + TRUE.depth_delay_s]))
        depths.append(room.render_depth(CAMERA, T_depth))
        px = np.where((hidden | out)[:, None], 0, px).astype(np.float32)
        points_camera = lift(px, depths[-1], CAMERA, CONFIG)
        points_camera[hidden | out] = np.nan
        ones = np.ones(POINTS)
        features = Features(px, np.zeros((POINTS, 128), np.uint8), ones, ones, 0 * ones, SPACE)
        frames.append(FrameFeatures(row, features, points_camera))
    return frames, depths


def edge(a: FrameFeatures, b: FrameFeatures) -> Edge:
    """The motion that registration finds from the matches, which are known."""
    both = np.flatnonzero(a.has_depth & b.has_depth)
    matches = np.column_stack([both, both]).astype(np.int32)
    found = Points3dEstimator(CONFIG).estimate(
        Correspondences(a, b, matches, (CAMERA, CAMERA), CONFIG), np.random.default_rng(0)
    )
    assert isinstance(found, PoseEstimate)
    return Edge(a.row, b.row, found.T_a_b, found.information)


def solved(
    recorded: tuple[list[FrameFeatures], list[np.ndarray]],
    config: OptimiseConfig,
    across: int | None = None,
) -> Solution:
    """Without closures ``across`` a frame, if one is named."""
    frames, depths = recorded
    keyframes = tuple(frames[::EVERY])
    number = np.arange(len(keyframes))
    pairs = [(i, j) for i in number for j in number[i + 1 : i + 7]]
    both = {
        (i, j): np.flatnonzero(keyframes[i].has_depth & keyframes[j].has_depth) for i, j in pairs
    }
    matches = [np.column_stack([0 * n + i, n, 0 * n + j, n]) for (i, j), n in both.items()]
    rows = np.arange(FRAMES)
    edges = [edge(frames[k], frames[k + 1]) for k in range(FRAMES - 1)]
    poses = [np.eye(4)]
    for e in edges:
        poses.append(poses[-1] @ e.T_i_j)
    table = FrameTable(0 * rows, rows, rows / RATE_HZ)
    odometry = Odometry(table, np.array(poses), 0 * rows, ("",) * FRAMES, tuple(edges), keyframes)
    closed = [(keyframes[i], keyframes[j]) for i, j in pairs]
    closures = [edge(a, b) for a, b in closed if across is None or not a.row < across <= b.row]
    every = np.concatenate(matches).astype(np.int32)
    whole = replace(Config(), optimise=config)
    return solve(odometry, closures, every, [CAMERA], whole, depth_of=depths.__getitem__)


def off_m(poses: np.ndarray) -> float:
    """Root mean square distance of positions from the true ones, after alignment."""
    true = pose(np.arange(FRAMES) / RATE_HZ)[:, :3, 3]
    aligned = se3.transform(se3.align(true, poses[:, :3, 3]), poses[:, :3, 3])
    return float(np.sqrt(((aligned - true) ** 2).sum(1).mean()))


@pytest.fixture(scope="module")
def allowed_for(recorded) -> Solution:
    return solved(recorded, OptimiseConfig())


@pytest.fixture(scope="module")
def left(recorded) -> Solution:
    return solved(recorded, OptimiseConfig(estimate_delays=False))


def test_delays_are_found_with_the_poses(allowed_for: Solution, left: Solution) -> None:
    (found,) = allowed_for.adjusted.sensor.errors
    assert found.depth_delay_s == pytest.approx(TRUE.depth_delay_s, rel=0.1)
    assert found.line_delay_s == pytest.approx(TRUE.line_delay_s, rel=0.1)
    assert not left.adjusted.sensor.delayed


def test_delays_that_are_allowed_for_leave_a_tenth(allowed_for: Solution, left: Solution) -> None:
    """Of frames between keyframes, too: both delays are known to a tenth."""
    assert off_m(allowed_for.poses) < 0.1 * off_m(left.poses)


def test_closures_that_only_delays_displace_are_kept(allowed_for: Solution, left: Solution) -> None:
    kept = left.robust.graph.kept
    assert kept.sum() < 0.9 * len(kept)
    assert allowed_for.robust.graph.kept.all()


def test_what_was_cut_before_delays_were_known_is_freed_of_them_too(
    recorded: tuple[list[FrameFeatures], list[np.ndarray]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Late depth can make edges contradict each other so much that a first pass cuts them."""
    given: list[Odometry] = []
    middle = FRAMES // 2

    def cutting(odometry: Odometry, *others: Any) -> RobustGraph:
        given.append(odometry)
        if len(given) == 1:
            kept = [e for e in odometry.edges if not e.i < middle <= e.j]
            odometry = with_edges(odometry, kept)
        return robust_pose_graph(odometry, *others)

    monkeypatch.setattr(solution, "robust_pose_graph", cutting)
    solved(recorded, OptimiseConfig(), across=middle)

    def off_rad(odometry: Odometry) -> float:
        (across,) = (e for e in odometry.edges if e.i < middle <= e.j)
        true = pose(np.array([across.i, across.j]) / RATE_HZ)
        return float(se3.rotation_angle(se3.inverse(across.T_i_j) @ se3.inverse(true[0]) @ true[1]))

    measured, freed = given
    assert off_rad(freed) < 0.2 * off_rad(measured)


def test_an_edge_that_is_freed_is_unsure_by_half_of_what_displaced_it(
    recorded: tuple[list[FrameFeatures], list[np.ndarray]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the length of a turn and of a shift, not along each axis: false loops gain by slack."""
    given: list[Odometry] = []

    def spying(odometry: Odometry, *others: Any) -> RobustGraph:
        given.append(odometry)
        return robust_pose_graph(odometry, *others)

    monkeypatch.setattr(solution, "robust_pose_graph", spying)
    solved(recorded, OptimiseConfig())
    measured, freed = (odometry.edges for odometry in given)
    for before, after in zip(measured, freed, strict=True):
        undone = se3.deviation(se3.inverse(before.T_i_j) @ after.T_i_j).reshape(2, 3)
        grown = np.linalg.inv(after.information) - np.linalg.inv(before.information)
        added = np.sqrt(np.diag(grown).reshape(2, 3).sum(1))
        assert added == pytest.approx(0.5 * np.linalg.norm(undone, axis=1), rel=0.01)
