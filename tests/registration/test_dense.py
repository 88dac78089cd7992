"""Planes, rendered exactly and with the sensor's noise, bare or painted, aligned by all pixels."""

import dataclasses

import numpy as np
import pytest

from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.frame import Frame, Rejected
from vnav.registration.dense import MOTION_SIGMAS, DenseEstimate, align, align_surfaces, fitted_near
from vnav.registration.reduction import reduced

CAMERA = Intrinsics(320, 240, 262.5, 262.5, 159.5, 119.5)
CONFIG = RegistrationConfig()
MOTION = se3.exp([0.02, -0.03, 0.01, 0.03, -0.02, 0.04])  # 2 degrees and 5 cm
WALL = np.array([[0.0, 0.0, 1.0, 2.0]])  # normal and distance: n x = d
NEAR_WALL = np.array([[0.0, 0.0, 1.0, 0.8]])
FAR_WALL = np.array([[0.0, 0.0, 1.0, 6.0]])
CORNER = np.array([[0.0, 0.0, 1.0, 2.5], [0.8, 0.0, 0.6, 1.6], [0.1, 0.9, 0.4, 1.2]])
STILL = np.eye(4)


def seen(
    planes: np.ndarray, T_world_camera: np.ndarray, seed: int | None = 0, exposure: float = 0.0
) -> Frame:
    """The nearest of the planes (N, 4), with the noise of the settings, and bare.

    With an ``exposure`` they are painted: waves of some 0.8 m, each in another direction, with
    noise of two grey levels.
    """
    px = np.stack(np.meshgrid(np.arange(320.0), np.arange(240.0)), -1).reshape(-1, 2)
    rays = CAMERA.unproject(px, np.ones(len(px))) @ T_world_camera[:3, :3].T
    normals, distances = planes[:, :3], planes[:, 3]
    inverse = ((rays @ normals.T) / (distances - normals @ T_world_camera[:3, 3])).max(1)
    points = rays / inverse[:, None] + T_world_camera[:3, 3]
    grey = np.full(len(px), 128.0)
    if exposure:
        waves = np.random.default_rng(0).normal(0, 8, (6, 3))
        grey = exposure * (100 + 12 * np.sin(points @ waves.T).sum(1))
    if seed is not None:
        rng = np.random.default_rng(seed)
        inverse = inverse + CONFIG.depth_sigma_per_m2 * rng.standard_normal(len(px))
        grey = grey + 2 * rng.standard_normal(len(px))
    color = np.repeat(grey.clip(0, 255).astype(np.uint8)[:, None], 3, 1).reshape(240, 320, 3)
    depth_m = (1 / inverse).reshape(240, 320).astype(np.float32)
    return Frame(0, 0, 0.0, color, depth_m, CAMERA)


def aligned(
    planes: np.ndarray,
    motion: np.ndarray,
    predicted: np.ndarray,
    seed: int = 0,
    exposures: tuple[float, float] = (0.0, 0.0),
) -> DenseEstimate | Rejected:
    a = seen(planes, STILL, 2 * seed, exposures[0])
    b = seen(planes, motion, 2 * seed + 1, exposures[1])
    return align(a, b, CAMERA, CONFIG, predicted)


def error(estimate: DenseEstimate | Rejected, motion: np.ndarray) -> np.ndarray:
    """Rotation and translation (6,) that the estimate is off."""
    assert isinstance(estimate, DenseEstimate), estimate
    T = se3.inverse(motion) @ estimate.T_a_b
    return np.concatenate([se3.log_so3(T[:3, :3]), T[:3, 3]])


def test_three_planes_fix_the_motion() -> None:
    # Depth noise of 1.4e-3 / m is 9 mm at 2.5 m; 2000 points average it to 0.2 mm. Ten times that.
    off = error(aligned(CORNER, MOTION, STILL), MOTION)
    assert np.abs(off).max() < 2e-3


def test_errors_are_no_larger_than_the_information_says() -> None:
    # It counts nine neighbouring pixels for one, which err alike in a sensor but not here: the
    # squared error of 6 degrees of freedom is far below one each, and never above.
    for seed in range(10):
        estimate = aligned(CORNER, MOTION, STILL, seed)
        assert isinstance(estimate, DenseEstimate)
        off = error(estimate, MOTION)
        assert off @ estimate.information @ off < 6


def test_a_wall_fixes_the_motion_towards_it_and_leaves_the_rest_to_the_prediction() -> None:
    along = se3.exp([0, 0, 0.02, 0.03, 0.01, 0.0])  # in the wall's own plane
    off = error(aligned(WALL, along @ se3.exp([0, 0, 0, 0, 0, 0.05]), along), along)
    assert off[5] == pytest.approx(0.05, abs=2e-3)
    assert np.abs(off[[2, 3, 4]]).max() < 0.005


def test_what_a_wall_leaves_open_is_known_no_better_than_predicted() -> None:
    estimate = aligned(WALL, STILL, STILL)
    assert isinstance(estimate, DenseEstimate)
    sigmas = np.sqrt(np.diagonal(np.linalg.inv(estimate.information)))
    open_ones = sigmas[[2, 3, 4]] / MOTION_SIGMAS[[2, 3, 4]]
    assert (open_ones > 0.8).all()
    assert (sigmas[[0, 1, 5]] < 0.2 * MOTION_SIGMAS[[0, 1, 5]]).all()


def test_surfaces_that_are_not_the_same_are_rejected() -> None:
    a, b = seen(CORNER, STILL), seen(CORNER, se3.exp([0, 1.2, 0, 0.5, 0, 0]))
    assert isinstance(align(a, b, CAMERA, CONFIG, STILL), Rejected)


def test_a_motion_far_from_the_prediction_is_rejected() -> None:
    forward = se3.exp([0, 0, 0, 0, 0, 0.4])
    assert isinstance(aligned(WALL, forward, STILL), Rejected)


@pytest.mark.parametrize("missing", ["a", "b"])
def test_without_depth_there_is_no_motion(missing: str) -> None:
    frames = {name: seen(CORNER, STILL) for name in "ab"}
    none = np.zeros_like(frames[missing].depth_m)
    frames[missing] = dataclasses.replace(frames[missing], depth_m=none)
    found = align(frames["a"], frames["b"], CAMERA, CONFIG, STILL)
    assert found == Rejected("too little depth in common")


def test_a_painted_wall_fixes_the_motion() -> None:
    # Of 9 000 pixels with paint 100 count; each tells the motion along the wall to 1 grey level of
    # some 5 per pixel, 0.2 of 7.6 mm: a tenth of that together. Ten times that.
    estimate = aligned(WALL, MOTION, STILL, exposures=(1.0, 1.0))
    assert np.abs(error(estimate, MOTION)).max() < 2e-3
    assert isinstance(estimate, DenseEstimate)
    assert estimate.well_constrained


def test_a_bare_wall_leaves_the_motion_degenerate() -> None:
    estimate = aligned(WALL, STILL, STILL)
    assert isinstance(estimate, DenseEstimate)
    assert not estimate.well_constrained


@pytest.mark.parametrize("exposures", [(1.0, 0.5), (0.5, 1.0), (1.0, 2.2)])
def test_a_painted_wall_fixes_the_motion_when_the_exposure_jumps(
    exposures: tuple[float, float],
) -> None:
    # At 2.2 a half of the pixels are clipped.
    off = error(aligned(WALL, MOTION, STILL, exposures=exposures), MOTION)
    assert np.abs(off).max() < 4e-3


def test_a_prediction_far_off_finds_the_way_on_a_painted_wall() -> None:
    far = se3.exp([0.05, -0.08, 0.03, 0.06, -0.08, 0.05])  # 5.6 degrees and 11 cm: 40 pixels
    off = error(aligned(WALL, far, STILL, exposures=(1.0, 1.0)), far)
    assert np.abs(off).max() < 2e-3


def test_errors_on_painted_walls_are_what_the_information_says() -> None:
    squared = []
    for seed in range(10):
        estimate = aligned(WALL, MOTION, STILL, seed, (1.0, 1.0))
        assert isinstance(estimate, DenseEstimate)
        off = error(estimate, MOTION)
        squared.append(off @ estimate.information @ off)
    # Never above: 60 degrees of freedom, 99.9 % of the sums are below 99.6.
    assert sum(squared) < 99.6


def seen_before_a_painted_room(T_world_camera: np.ndarray, seed: int) -> Frame:
    """A bare wall that ends at x = 0; beside it a painted one, too far away to have depth."""
    near, far = seen(WALL, T_world_camera, seed), seen(FAR_WALL, T_world_camera, seed, 1.0)
    px = np.stack(np.meshgrid(np.arange(320.0), np.arange(240.0)), -1)
    rays = CAMERA.unproject(px.reshape(-1, 2), np.ones(240 * 320)) @ T_world_camera[:3, :3].T
    reach = (WALL[0, 3] - T_world_camera[2, 3]) / rays[:, 2]
    beside = (T_world_camera[0, 3] + reach * rays[:, 0] > 0).reshape(240, 320)
    color = np.where(beside[..., None], far.color, near.color)
    return dataclasses.replace(near, color=color, depth_m=np.where(beside, 0, near.depth_m))


def seen_relief(T_world_camera: np.ndarray, seed: int) -> Frame:
    """A bare wall with a post of 4 cm, the sides of which are slopes as wide."""
    frame = seen(NEAR_WALL, T_world_camera, None)
    px = np.stack(np.meshgrid(np.arange(320.0), np.arange(240.0)), -1).reshape(-1, 2)
    rays = CAMERA.unproject(px, np.ones(len(px))) @ T_world_camera[:3, :3].T
    z = frame.depth_m.ravel().astype(float)
    for _ in range(30):
        x, _, at = (T_world_camera[:3, 3] + rays * z[:, None]).T
        height = (x - 0.05).clip(0, 0.04) - (x - 0.17).clip(0, 0.04)
        z += 0.7 * (NEAR_WALL[0, 3] - height - at) / rays[:, 2]
    noise = CONFIG.depth_sigma_per_m2 * np.random.default_rng(seed).standard_normal(len(px))
    depth_m = (1 / (1 / z + noise)).reshape(240, 320).astype(np.float32)
    return dataclasses.replace(frame, depth_m=depth_m)


@pytest.mark.parametrize("along_m", [-0.025, 0.025])
def test_what_stands_out_of_a_wall_is_found_from_either_side(along_m: float) -> None:
    motion = se3.exp([0.0, 0.005, 0.0, 0.02, 0.0, 0.01])
    a, b = (seen_relief(T, k) for k, T in enumerate((STILL, motion)))
    estimate = align(a, b, CAMERA, CONFIG, motion @ se3.exp([0, 0, 0, along_m, 0, 0]))
    assert abs(error(estimate, motion)[3]) < 0.002


@pytest.mark.parametrize("seed", range(3))
def test_what_lies_behind_the_edge_of_a_wall_does_not_move_the_wall(seed: int) -> None:
    motion = se3.exp([0.0, 0.01, 0.0, 0.05, 0.0, 0.02])
    a, b = (seen_before_a_painted_room(T, 2 * seed + k) for k, T in enumerate((STILL, motion)))
    estimate = align(a, b, CAMERA, CONFIG, motion)
    assert isinstance(estimate, DenseEstimate)
    off = error(estimate, motion)
    assert off @ estimate.information @ off < 6


def test_a_wall_that_most_channels_see_clipped_fixes_the_motion_when_the_exposure_jumps() -> None:
    yellow = np.array([1.8, 1.8, 0.5])
    a, b = (
        dataclasses.replace(f, color=(f.color * yellow * gain).clip(0, 255).astype(np.uint8))
        for f, gain in ((seen(WALL, STILL, 0, 1.0), 0.8), (seen(WALL, MOTION, 1, 1.0), 1.6))
    )
    estimate = align(a, b, CAMERA, CONFIG, STILL)
    assert isinstance(estimate, DenseEstimate)
    assert estimate.well_constrained
    off = error(estimate, MOTION)
    assert off @ estimate.information @ off < 6


NEARLY = MOTION @ se3.exp([0.002, -0.003, 0.002, 0.005, 0.005, -0.005])  # 0.2 degrees, 9 mm


def by_surfaces(a: Frame, b: Frame) -> DenseEstimate | Rejected:
    return align_surfaces(reduced(a), reduced(b), CONFIG, NEARLY)


def test_surfaces_alone_fix_the_motion_of_images_that_are_lit_otherwise() -> None:
    # A block of 16 pixels has a quarter of their noise; 200 points average 2 mm of it to 0.2.
    off = error(by_surfaces(seen(CORNER, STILL, 0, 1.0), seen(CORNER, MOTION, 1)), MOTION)
    assert np.abs(off).max() < 2e-3


def test_a_surface_that_stands_before_another_does_not_draw_it_near() -> None:
    b = seen(CORNER, MOTION, 1)
    nearer = b.depth_m.copy()
    nearer[:, :120] -= 0.2  # 6 to 60 sigma of inverse depth
    off = error(by_surfaces(seen(CORNER, STILL, 0), dataclasses.replace(b, depth_m=nearer)), MOTION)
    assert np.abs(off).max() < 4e-3  # what is left of the corner


def test_surfaces_that_share_nothing_fix_nothing() -> None:
    b = seen(CORNER, MOTION, 1)
    blind = dataclasses.replace(b, depth_m=np.zeros_like(b.depth_m))
    assert isinstance(by_surfaces(seen(CORNER, STILL, 0), blind), Rejected)


def test_the_motion_of_a_part_is_found_from_that_of_another() -> None:
    a, b = (reduced(seen(CORNER, T, k, 1.0)) for k, T in enumerate((STILL, MOTION)))
    _, across = np.mgrid[:1, : b.grey.shape[1]]
    right = np.broadcast_to(across >= b.grey.shape[1] // 2, b.grey.shape)
    there = se3.exp([0.0, 0.0, 0.0, 0.0, 0.0, 0.1])  # where the left part moved to
    found = fitted_near(a, b.without(~right), CONFIG, MOTION @ there)
    off = np.abs(se3.deviation(se3.inverse(MOTION) @ found))
    assert off[:3].max() < np.deg2rad(0.3)
    assert off[3:].max() < 0.01  # a tenth of what it began with


def test_where_no_surface_is_left_the_prediction_stays() -> None:
    a, b = (reduced(seen(CORNER, T, k, 1.0)) for k, T in enumerate((STILL, MOTION)))
    found = fitted_near(a, b.without(np.ones(b.grey.shape, bool)), CONFIG, MOTION)
    np.testing.assert_allclose(found, MOTION, atol=1e-9)
