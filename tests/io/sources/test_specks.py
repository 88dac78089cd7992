"""Single wrong pixels in depth images."""

import numpy as np
import pytest
from numpy.typing import NDArray

from vnav.io.sources.specks import MOST_PX, without_specks

SIGMA_PER_M = 0.0014  # noise of a Kinect in inverse depth


def room(seed: int = 0) -> NDArray[np.float32]:
    """A floor from 1.2 to 5 m and a box before it, with the noise of a Kinect."""
    inverse = np.tile(np.linspace(1 / 5, 1 / 1.2, 240)[:, None], (1, 320))
    inverse[60:140, 100:180] = 1 / 0.9
    inverse += SIGMA_PER_M * np.random.default_rng(seed).standard_normal(inverse.shape)
    return (1 / inverse).astype(np.float32)


def test_random_pixels_go_and_surfaces_stay() -> None:
    clean, rng = room(), np.random.default_rng(1)
    wrong = rng.random(clean.shape) < 0.05
    spoilt = np.where(wrong, rng.uniform(0.4, 8.0, clean.shape), clean).astype(np.float32)
    left = without_specks(spoilt)
    # A pixel drawn within the step of one beside it is not told from the surface.
    assert (left[wrong] > 0).mean() < 0.05
    assert (left[~wrong] == 0).mean() < 0.01
    np.testing.assert_array_equal(left[left > 0], spoilt[left > 0])


def test_of_a_clean_image_hardly_a_pixel_goes() -> None:
    assert (without_specks(room()) == 0).mean() < 1e-3


@pytest.mark.parametrize(("across", "is_kept"), [(MOST_PX, False), (MOST_PX + 1, True)])
def test_a_patch_stays_if_it_is_large_enough_to_be_a_thing(across: int, is_kept: bool) -> None:
    depth_m = np.full((40, 40), 3.0, np.float32)
    depth_m[20, 10 : 10 + across] = 1.0
    assert (without_specks(depth_m)[20, 10 : 10 + across] > 0).all() == is_kept


def test_a_lone_measurement_among_none_stays() -> None:
    depth_m = np.zeros((40, 40), np.float32)
    depth_m[::5, ::5] = np.linspace(1, 4, 64).reshape(8, 8)
    np.testing.assert_array_equal(without_specks(depth_m), depth_m)


def test_depth_nearer_than_the_steps_reach_stays() -> None:
    near = np.full((40, 40), 0.1, np.float32)
    np.testing.assert_array_equal(without_specks(near), near)
