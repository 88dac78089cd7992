"""Motions of three matches each, as the compiled loops of RANSAC find them."""

import numpy as np
import pytest

from vnav.core import se3
from vnav.registration.consensus import best_motion

CAMERA = np.array([525.0, 525.0, 319.5, 239.5])
LIMITS = np.array([3.0, 3.0, 0.03])
NOISE_M = 0.01


@pytest.mark.parametrize("seed", range(10))
def test_three_matches_have_the_motion_of_least_squares(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a = rng.uniform([-1, -1, 2], [1, 1, 4], (3, 3))
    T_a_b = se3.exp(rng.uniform(-0.5, 0.5, 6))
    b = se3.transform(se3.inverse(T_a_b), a) + rng.normal(0, NOISE_M, (3, 3))
    assert np.allclose(of_sample(a, b), se3.inverse(se3.align(b, a)), atol=1e-9)


def test_three_matches_on_a_line_have_a_motion_that_puts_their_middle_right() -> None:
    a = np.array([[0, 0, 2.0], [0.5, 0, 2], [1, 0, 2]])
    b = a + np.array([0.1, 0.2, 0.3])
    T_a_b = of_sample(a, b)
    assert se3.is_rigid(T_a_b)
    assert np.allclose(se3.transform(T_a_b, b.mean(0)), a.mean(0))


def of_sample(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The motion that the only sample has, by points (3, 3) of either camera."""
    px = CAMERA[:2] * b[:, :2] / b[:, 2:] + CAMERA[2:]
    found = best_motion(np.arange(3)[None], a, b, px, CAMERA, LIMITS, 0.99)
    return np.asarray(found)
