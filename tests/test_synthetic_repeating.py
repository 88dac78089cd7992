"""Scenes that repeat themselves are the same where they say so, and only there."""

from functools import cache

import numpy as np
import pytest

from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.grid import FREE
from vnav.synthetic import MINIATURE, SCENES, CaptureSpec, Scene
from vnav.synthetic.aisles import LENGTH_M, PERIODS_M, TILE_M, WIDTH_M, period_of
from vnav.synthetic.path import frames_at, look
from vnav.synthetic.rendered_capture import camera_poses

pytestmark = pytest.mark.slow

CAMERA = MINIATURE.camera
COARSE = CAMERA.scaled(80, 60)
NARROW = Intrinsics(160, 120, 700.0, 700.0, 79.5, 59.5)  # sees 0.3 x 0.2 m of a shelf
STEP_M, UNEVEN = 0.07, 0.43
REPEATING = ["library", "supermarket", "shop", "twin_rooms"]


@cache
def scene_of(name: str, seed: int = 0) -> Scene:
    """Each once: its textures take a second."""
    return SCENES[name](seed)


def level(x: float, y: float, z: float, yaw_deg: float) -> np.ndarray:
    """T_world_camera of a level camera."""
    zero = np.zeros(1)
    return look(np.array([[x, y, z]]), np.deg2rad([yaw_deg]), zero, zero)[0]


def moved_along(T_world_camera: np.ndarray, x_m: float) -> np.ndarray:
    return se3.make(T_world_camera[:3, :3], T_world_camera[:3, 3] + [x_m, 0.0, 0.0])


def differing(scene: Scene, camera: Intrinsics, T: np.ndarray, by_m: float) -> float:
    """Share of pixels that change by more than rounding when the camera moves along x."""
    one, other = (
        scene.render_color(camera, pose).astype(int) for pose in (T, moved_along(T, by_m))
    )
    # Rounded coordinates may fall on the next texel, at edges.
    return float((np.abs(one - other).max(2) > 2).mean())


def walk_of(name: str, seed: int = 0, uneven: float = UNEVEN) -> tuple[Scene, np.ndarray]:
    scene = scene_of(name, seed)
    frames = frames_at(STEP_M, scene.tour)
    spec = CaptureSpec(name, frames, 0, CAMERA, CAMERA, seed=seed, uneven=uneven)
    return scene, camera_poses(scene, spec)


@pytest.mark.parametrize("name", ["library", "library_bare", "supermarket"])
def test_a_shelf_repeats_itself_period_by_period(name: str) -> None:
    """Books and a board fill the image, amid a shelf and below the card."""
    aisle, period_m = scene_of(name), period_of(0)
    T = level(LENGTH_M / 2 - period_m, 1.6, 0.6, 90.0)
    assert aisle.render_color(NARROW, T).std() > 10
    assert differing(aisle, NARROW, T, period_m) < 0.01
    assert differing(aisle, NARROW, T, 2 * period_m) < 0.01
    assert differing(aisle, NARROW, T, 0.5 * period_m) > 0.1


def test_a_bare_library_is_the_same_view_period_by_period() -> None:
    """All of a frame of the walk, in colour and in depth."""
    scene, T_world_camera = walk_of("library_bare")
    period_m = period_of(0)
    for T in T_world_camera[::20]:
        assert differing(scene, CAMERA, T, period_m) < 0.01
        one, other = (scene.render_depth(CAMERA, p) for p in (T, moved_along(T, period_m)))
        assert (np.abs(one - other) > 1e-4).mean() < 0.01


def test_tiles_of_the_supermarket_are_the_same() -> None:
    place = scene_of("supermarket")
    wall = level(2.75, 1.0, 1.8, -90.0)  # above the posters' upper edge, 1.5 m
    narrow = Intrinsics(160, 120, 400.0, 400.0, 79.5, 59.5)
    assert place.render_color(narrow, wall).std() > 5
    assert differing(place, narrow, wall, TILE_M) < 0.01
    zero = np.zeros(1)
    down = look(np.array([[3.0, WIDTH_M / 2, 1.2]]), zero, np.deg2rad([-89.0]), zero)[0]
    assert differing(place, narrow, down, TILE_M) < 0.01


@pytest.mark.parametrize("seed", range(5))
def test_the_seed_draws_the_period(seed: int) -> None:
    low_m, high_m = PERIODS_M
    assert low_m <= period_of(seed) <= high_m
    assert period_of(seed) != period_of(seed + 1)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("name", ["library", "supermarket"])
def test_a_twentieth_of_every_view_is_unique(name: str, seed: int) -> None:
    scene, T_world_camera = walk_of(name, seed)
    shares = [scene.has_unique_look(COARSE, T).mean() for T in T_world_camera[::2]]
    assert min(shares) >= 0.05
    assert np.median(shares) < 0.35


def test_nothing_in_the_views_of_a_bare_library_is_unique() -> None:
    scene, T_world_camera = walk_of("library_bare")
    assert not any(scene.has_unique_look(COARSE, T).any() for T in T_world_camera)


@pytest.mark.parametrize("name", REPEATING)
def test_the_walk_among_unlike_things_is_the_same_walk_and_nothing_repeats(name: str) -> None:
    scene, T_world_camera = walk_of(name)
    unlike, T_unlike = walk_of(f"{name}_unlike")
    np.testing.assert_array_equal(T_unlike, T_world_camera)
    for T in T_world_camera[::40]:
        np.testing.assert_array_equal(unlike.render_depth(COARSE, T), scene.render_depth(COARSE, T))
    assert not any(face.twin for face in unlike.faces)


def test_unlike_books_do_not_repeat() -> None:
    T = level(LENGTH_M / 2 - period_of(0), 1.6, 0.6, 90.0)
    assert differing(scene_of("library_unlike"), NARROW, T, period_of(0)) > 0.5


@pytest.mark.parametrize("name", ["library", "library_bare", "supermarket"])
def test_the_walk_along_the_shelves_is_free(name: str) -> None:
    scene, T_world_camera = walk_of(name)
    grid = scene.grid(0.05, 0.1, 1.4)
    cells = grid.cells_at(T_world_camera[:, :2, 3])
    assert (grid.cells[tuple(cells.T)] == FREE).all()


@pytest.mark.parametrize("uneven", [0.0, UNEVEN])
def test_steps_are_as_long_as_asked_for_and_as_uneven(uneven: float) -> None:
    """Of all walks, that of a bare library turns least; where it turns back it steps less."""
    _, T_world_camera = walk_of("library_bare", uneven=uneven)
    steps_m = np.linalg.norm(np.diff(T_world_camera[:, :2, 3], axis=0), axis=1)
    # Turning takes its share of the first and last steps; sampling 16 a wave misses 2 % of it.
    low_m, high_m = np.quantile(steps_m, [0.05, 1])
    assert low_m == pytest.approx((1 - uneven) * STEP_M, abs=0.006)
    assert high_m == pytest.approx((1 + uneven) * STEP_M, abs=0.006)


def test_an_aisle_is_the_same_bytes_for_a_seed_and_others_for_another() -> None:
    T = level(LENGTH_M / 2, 1.6, 1.2, 90.0)
    scenes = scene_of("library"), SCENES["library"](0), SCENES["library"](1)
    first, again, other = (scene.render_color(COARSE, T).tobytes() for scene in scenes)
    assert first == again
    assert first != other
