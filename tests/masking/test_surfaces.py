"""Surfaces: where one ends."""

import numpy as np

from tests.masking.moving_box import CAMERA
from vnav.core.reduced_frame import ReducedFrame
from vnav.masking.surfaces import surfaces

SHAPE = (CAMERA.height, CAMERA.width)
ROWS, COLUMNS = np.indices(SHAPE)
RAY_X, RAY_Y = (COLUMNS - CAMERA.cx) / CAMERA.fx, (ROWS - CAMERA.cy) / CAMERA.fy
SIGMA = 0.0014 / 4  # noise of inverse depth, 16 pixels a block


def numbers(depth_m: np.ndarray, sigma: float = SIGMA) -> np.ndarray:
    noise = sigma * np.random.default_rng(0).standard_normal(SHAPE)
    inverse_depth = np.where(depth_m > 0, 1 / np.maximum(depth_m, 0.1) + noise, 0)
    return surfaces(ReducedFrame(0.0, np.zeros(SHAPE), inverse_depth, CAMERA))


def largest(parts: np.ndarray) -> int:
    return int(np.bincount(parts[parts > 0]).argmax())


def test_a_plane_at_a_slant_is_one_surface() -> None:
    found = numbers(2 / (1 - 0.5 * RAY_X))
    assert (found == largest(found)).mean() > 0.98


def test_a_step_ends_a_surface_and_no_depth_is_none() -> None:
    found = numbers(np.where(COLUMNS < 30, 2.0, np.where(COLUMNS > 50, 2.2, 0.0)))
    assert (found[:, 30:51] == 0).all()
    assert not np.intersect1d(found[:, :30], found[:, 51:]).size


def test_a_wall_and_the_floor_before_it_are_two_surfaces() -> None:
    floor_m = 1.0 / np.maximum(RAY_Y, 1e-6)
    found = numbers(np.minimum(3.0, floor_m))
    wall, floor = found[:20], found[floor_m < 2.7]
    assert largest(wall) != largest(floor)
    assert not np.isin(wall, largest(floor)).any()


def test_a_body_whose_edges_bend_outwards_is_one_surface() -> None:
    edge = numbers(2.0 + 0.6 * np.abs(RAY_X))  # towards the camera in the middle
    assert (edge == largest(edge)).mean() > 0.95


def strip_between(width: int) -> np.ndarray:
    """Depth of two halves of a plane that a strip of so many blocks' width joins."""
    beside = np.abs(ROWS - SHAPE[0] / 2 + 0.5) > width / 2
    gap = (COLUMNS >= 30) & (COLUMNS < 34) & beside
    return np.where(gap, 0.0, 2.0)


def test_what_is_joined_over_two_blocks_alone_is_not_one_surface() -> None:
    found = numbers(strip_between(2), sigma=0.0)
    assert not np.intersect1d(found[:, :30], found[:, 34:]).size
    assert set(np.unique(found[:, 30:34])) <= {0, largest(found[:, :30]), largest(found[:, 34:])}


def test_what_is_joined_over_six_blocks_is_one_surface() -> None:
    found = numbers(strip_between(6), sigma=0.0)
    assert largest(found[:, :30]) == largest(found[:, 34:])


def test_a_narrow_part_has_the_number_of_the_surface_that_it_is_of() -> None:
    arm = (COLUMNS < 30) | ((COLUMNS < 45) & (ROWS >= 20) & (ROWS < 22))
    found = numbers(np.where(arm, 2.0, 0.0), sigma=0.0)
    assert (found[arm] == largest(found)).all()
