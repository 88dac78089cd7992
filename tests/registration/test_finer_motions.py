"""Motions whose matches one motion between them takes for its own."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.frame import Features
from vnav.core.mapping import FrameFeatures
from vnav.features.matching import DescriptorMatcher
from vnav.features.sift import SPACE
from vnav.registration.correspondences import Correspondences
from vnav.registration.finer_motions import finer_motions
from vnav.registration.points3d import PointRegistration

CAMERA = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
CONFIG = RegistrationConfig()
SHARP = 0.2  # of the noise in the settings, as rendered images have it
COUNT = 150
STILL = se3.exp([0.002, -0.004, 0.001, 0.006, -0.002, 0.003])  # of the camera, in a step at 30 Hz
BETWEEN = se3.exp([0, 0, 0, -0.0075, 0, 0]) @ STILL
SLIDES = se3.make(np.eye(3), np.array([0.015, 0, 0]))  # 0.45 m/s: 4 px at 2 m


def views(
    rng: np.random.Generator,
    moves: float,
    noise: float,
    slides: Array = SLIDES,
    away_m: float = 2.0,
) -> tuple[FrameFeatures, FrameFeatures]:
    """Of a room 2.5 to 4 m away, and before it a share of points that slide."""
    px = rng.uniform([20, 20], [619, 459], (COUNT, 2))
    is_moving = np.arange(COUNT) < moves * COUNT
    depth_m = np.where(is_moving, away_m, rng.uniform(2.5, 4, COUNT))
    before = CAMERA.unproject(px, depth_m)
    after = np.where(is_moving[:, None], se3.transform(slides, before), before)
    descriptors = rng.integers(0, 100, (COUNT, 128)).astype(np.uint8)
    points = before, se3.transform(se3.inverse(STILL), after)
    a, b = (measured(p, descriptors, rng, noise) for p in points)
    return a, b


def measured(
    points: Array, descriptors: np.ndarray, rng: np.random.Generator, noise: float
) -> FrameFeatures:
    """What the camera sees of points (N, 3), with a share of the noise of the settings."""
    px = CAMERA.project(points) + noise * CONFIG.pixel_sigma_px * rng.standard_normal((COUNT, 2))
    w = 1 / points[:, 2] + noise * CONFIG.depth_sigma_per_m2 * rng.standard_normal(COUNT)
    features = Features(px, descriptors, np.ones(COUNT), np.ones(COUNT), np.zeros(COUNT), SPACE)
    return FrameFeatures(0, features, CAMERA.unproject(px, 1 / w))


ALL = np.repeat(np.arange(COUNT, dtype=np.int32)[:, None], 2, 1)


def found(seed: int, moves: float, noise: float) -> list[Array]:
    """Beside the one that matches are refined to from between the two."""
    rng = np.random.default_rng(seed)
    of = measuring(*views(rng, moves, noise))
    return finer_motions(of, ALL, of(ALL).refined(BETWEEN)[0], rng)


def measuring(a: FrameFeatures, b: FrameFeatures) -> Callable[[NDArray[np.int32]], Correspondences]:
    return lambda matches: Correspondences(a, b, matches, (CAMERA, CAMERA), CONFIG)


def off_m(T_a_b: Array) -> float:
    """How far a motion puts what stands still 3 m ahead from where it is."""
    ahead = np.array([[0, 0, 3.0]])
    return float(np.linalg.norm(se3.transform(T_a_b, ahead) - se3.transform(STILL, ahead)))


@pytest.mark.parametrize("moves", [0.3, 0.5, 0.7])
def test_a_panel_that_slides_by_four_pixels_is_told_from_the_room(moves: float) -> None:
    """A tenth of what it slides by is three times the noise of 45 points."""
    for seed in range(5):
        motions = found(seed, moves, SHARP)
        assert min(map(off_m, motions)) < 0.1 * SLIDES[0, 3]
        assert max(map(off_m, motions)) > 0.5 * SLIDES[0, 3]


@pytest.mark.parametrize("noise", [0.05, SHARP, 1.0])
def test_a_room_in_which_nothing_moves_has_one_motion(noise: float) -> None:
    assert not any(found(seed, 0.0, noise) for seed in range(20))


def test_what_slides_by_little_more_than_the_noise_leaves_one_motion() -> None:
    """Noise puts a match 0.7 px off in either direction, the motion between 2 px."""
    assert not any(found(seed, 0.5, 0.5) for seed in range(20))


def test_what_moves_on_a_tenth_of_the_matches_is_left_to_the_robust_refinement() -> None:
    assert not any(found(seed, 0.1, SHARP) for seed in range(5))


def test_the_motion_of_the_room_is_among_those_that_a_pair_of_frames_suggests() -> None:
    pair = PointRegistration(CAMERA, CAMERA, CONFIG, DescriptorMatcher(CONFIG))
    a, b = views(np.random.default_rng(0), 0.6, SHARP)
    suggested = pair.hypotheses(a, b, np.random.default_rng(0), np.eye(4))
    assert isinstance(suggested, list)
    assert off_m(suggested[0].T_a_b) > 0.2 * SLIDES[0, 3]
    assert min(off_m(e.T_a_b) for e in suggested) < 0.1 * SLIDES[0, 3]


def test_of_a_motion_that_few_matches_bend_the_one_of_most_is_told() -> None:
    """A step to the side with a turn, by which what is 3 m away stays in its place."""
    bent = STILL @ se3.exp([0, 0.01, 0, -0.03, 0, 0])
    for seed in range(5):
        rng = np.random.default_rng(seed)
        of = measuring(*views(rng, 0.125, SHARP, WALKS, NEAR_M))
        (motion,) = finer_motions(of, ALL, bent, rng)
        assert np.linalg.norm((se3.inverse(STILL) @ motion)[:3, 3]) < 0.005


NEAR_M, WALKS = 1.2, se3.make(np.eye(3), np.array([-0.026, 0.0, 0.0]))  # 0.8 m/s at 30 Hz


@pytest.mark.parametrize("seed", range(8))
def test_few_matches_of_what_walks_close_by_do_not_bend_the_motion_of_the_room(seed: int) -> None:
    """All are within the noise assumed of a step of 3.3 cm with a turn.

    A seventh of that is five times what the noise of the room's own matches leaves open.
    """
    rng = np.random.default_rng(seed)
    a, b = views(rng, 0.125, SHARP, WALKS, NEAR_M)
    pair = PointRegistration(CAMERA, CAMERA, CONFIG, DescriptorMatcher(CONFIG))
    suggested = pair.hypotheses(a, b, rng)
    assert isinstance(suggested, list)
    for estimate in suggested:
        off = se3.inverse(STILL) @ estimate.T_a_b
        assert np.linalg.norm(off[:3, 3]) < 0.005
