"""Motions between keyframes against their pixels."""

import numpy as np
import pytest

from vnav.checking.motions import contradicting_loops, standing_steps, unborne_steps
from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.frame import Edge
from vnav.core.reduced_frame import ReducedFrame

CONFIG = RegistrationConfig()
CAMERA = Intrinsics(80, 60, 65.0, 65.0, 39.5, 29.5)
WALL_M = 2.0
STEP_M = 4 * WALL_M / CAMERA.fx  # the wall moves by 4 pixels
PERIOD_M = 8 * WALL_M / CAMERA.fx
PAPER = np.random.default_rng(0).uniform(0, 255, (60, 100)).astype(np.float32)


def wall(row: int, pattern: np.ndarray) -> ReducedFrame:
    """A papered wall before a camera that has gone some steps to the right."""
    noise = CONFIG.depth_sigma_per_m2 / 4 * np.random.default_rng(row).standard_normal((60, 80))
    grey = pattern[:, 4 * row : 4 * row + 80]
    return ReducedFrame(0.0, grey, (1 / WALL_M + noise).astype(np.float32), CAMERA)


def unlike(row: int) -> ReducedFrame:
    return wall(row, PAPER)


def alike(row: int) -> ReducedFrame:
    return wall(row, np.tile(PAPER[:, :8], (1, 13)))


def aside(metres: float) -> np.ndarray:
    return se3.make(np.eye(3), [metres, 0.0, 0.0])


@pytest.fixture
def poses() -> np.ndarray:
    """True poses of four frames."""
    return np.stack([aside(k * STEP_M) for k in range(4)])


ROWS = np.arange(4)
STEPS = [Edge(k, k + 1, aside(STEP_M), np.eye(6)) for k in range(3)]


def test_true_steps_are_borne_out(poses: np.ndarray) -> None:
    assert unborne_steps(ROWS, STEPS, poses, unlike, CONFIG) == []


def test_steps_to_and_from_a_wrong_pose_are_not(poses: np.ndarray) -> None:
    poses[2] = poses[2] @ aside(0.3)
    assert unborne_steps(ROWS, STEPS, poses, unlike, CONFIG) == [(1, 2), (2, 3)]


def test_no_step_leads_on_without_a_motion_or_to_no_pose(poses: np.ndarray) -> None:
    poses[2] = poses[2] @ aside(0.3)
    found_again = Edge(0, 2, aside(2 * STEP_M), np.eye(6))
    cut = [STEPS[0], found_again, STEPS[2]]
    assert unborne_steps(ROWS, cut, poses, unlike, CONFIG) == [(2, 3)]
    poses[2] = np.nan
    assert unborne_steps(ROWS, STEPS, poses, unlike, CONFIG) == []


def test_a_step_leads_over_frames_that_are_no_keyframes(poses: np.ndarray) -> None:
    poses[2:] = poses[2:] @ aside(0.3)
    assert unborne_steps(ROWS[[0, 3]], STEPS, poses, unlike, CONFIG) == [(0, 3)]


def test_a_loop_that_fits_the_images_contradicts_a_map_that_does_not(poses: np.ndarray) -> None:
    loop = Edge(0, 3, aside(3 * STEP_M), np.eye(6))
    assert contradicting_loops([loop], poses, unlike, CONFIG) == []
    poses[2:] = poses[2:] @ aside(0.2)
    assert contradicting_loops([loop], poses, unlike, CONFIG) == [loop]


def test_a_false_loop_that_fits_no_better_contradicts_nothing(poses: np.ndarray) -> None:
    false = Edge(0, 3, aside(3 * STEP_M - PERIOD_M), np.eye(6))
    assert contradicting_loops([false], poses, alike, CONFIG) == []


def test_a_loop_to_a_twin_place_contradicts_no_map_that_has_it_out_of_view(
    poses: np.ndarray,
) -> None:
    poses[2:] = aside(6.0) @ poses[2:]  # another wall with the same paper
    twin = Edge(0, 3, aside(3 * STEP_M), np.eye(6))
    assert contradicting_loops([twin], poses, unlike, CONFIG) == []


def test_a_loop_to_a_frame_without_a_pose_tells_nothing(poses: np.ndarray) -> None:
    poses[3] = np.nan
    loop = Edge(0, 3, aside(0.0), np.eye(6))
    assert contradicting_loops([loop], poses, unlike, CONFIG) == []


def lower_part(share: float) -> np.ndarray:
    """So much of the blocks of a keyframe, from below."""
    moving = np.zeros((60, 80), bool)
    moving[60 - round(60 * share) :] = True
    return moving


def a_period_on(poses: np.ndarray) -> np.ndarray:
    """Poses of a track that goes on by a period of the wall too much in each step."""
    return np.stack([T @ aside(k * PERIOD_M) for k, T in enumerate(poses)])


def test_what_repeats_and_is_taken_for_moving_is_seen_to_stand(poses: np.ndarray) -> None:
    """By a track that is wrong by a period a step, as that by which it was masked."""
    for track in (poses, a_period_on(poses)):
        steps = standing_steps(ROWS, STEPS, track, alike, lambda _: lower_part(0.6), CONFIG)
        assert steps == [(0, 1), (1, 2), (2, 3)]


def test_what_moves_on_most_of_the_view_is_seen_to_move(poses: np.ndarray) -> None:
    """The wall goes by a period a step, and is unlike itself."""
    moves = standing_steps(
        ROWS, STEPS, a_period_on(poses), unlike, lambda _: lower_part(0.6), CONFIG
    )
    assert moves == []


def test_what_is_masked_on_half_of_the_view_may_stand(poses: np.ndarray) -> None:
    """As people do who go on later."""
    assert standing_steps(ROWS, STEPS, poses, unlike, lambda _: lower_part(0.5), CONFIG) == []


def test_two_steps_with_most_of_the_view_masked_are_no_doubt(poses: np.ndarray) -> None:
    assert (
        standing_steps(ROWS[:3], STEPS, poses[:3], unlike, lambda _: lower_part(0.6), CONFIG) == []
    )


def test_keyframes_without_a_pose_tell_nothing_of_masks(poses: np.ndarray) -> None:
    poses[3] = np.nan
    assert standing_steps(ROWS, STEPS, poses, unlike, lambda _: lower_part(0.6), CONFIG) == []


def test_no_step_with_most_masked_leads_over_a_cut(poses: np.ndarray) -> None:
    """Two are left, of the three that make a doubt."""
    steps = standing_steps(ROWS, STEPS[:2], poses, alike, lambda _: lower_part(0.6), CONFIG)
    assert steps == []


def test_steps_with_most_masked_that_do_not_follow_each_other_are_no_doubt() -> None:
    """Three are, of five; between them less is masked."""
    rows = np.arange(6)
    poses = np.stack([aside(k * STEP_M) for k in rows])
    steps = [Edge(k, k + 1, aside(STEP_M), np.eye(6)) for k in range(5)]
    masks = {row: lower_part(0.6 if row % 2 else 0.4) for row in rows.tolist()}
    assert standing_steps(rows, steps, poses, alike, masks.__getitem__, CONFIG) == []
