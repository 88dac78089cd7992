"""The noise of depth that an image shows: of planes, with what a sensor adds."""

import numpy as np
import pytest

from vnav.core.depth_planes import depth_noise

REACH_PX = 4
SIGMA = 0.002  # of inverse depth, 1/m


def slanted(sigma: float, size: tuple[int, int] = (240, 320)) -> np.ndarray:
    """Inverse depth (H, W) of a plane from 1.4 to 5 m, with that noise."""
    v, u = np.mgrid[: size[0], : size[1]] / np.array(size)[:, None, None]
    noise = np.random.default_rng(0).normal(0, sigma, size)
    return np.asarray(0.2 + 0.3 * u + 0.2 * v + noise)


def shown(inverse_depth: np.ndarray, max_depth_m: float = np.inf) -> float:
    with np.errstate(divide="ignore"):
        depth_m = np.where(inverse_depth > 0, 1 / inverse_depth, 0).astype(np.float32)
    return depth_noise(depth_m, REACH_PX, max_depth_m)


@pytest.mark.parametrize("sigma", [0.0005, 0.002, 0.01])
def test_a_plane_shows_the_noise_that_was_put_in(sigma: float) -> None:
    # In windows of 81 pixels it varies by 8 %, so their first quartile is 5 % below; 78 of 81
    # degrees of freedom are 2 %. The quartile of 256 windows varies by 1 %.
    assert shown(slanted(sigma)) == pytest.approx(0.93 * sigma, rel=0.04)


def test_steps_of_disparity_count_as_noise() -> None:
    step = 4 * SIGMA
    stepped = np.rint(slanted(SIGMA) / step) * step
    # Rounding adds step^2 / 12.
    assert shown(stepped) == pytest.approx(0.93 * np.hypot(SIGMA, step / np.sqrt(12)), rel=0.06)


@pytest.mark.parametrize("share", [0.3, 0.7])
def test_edges_in_most_of_an_image_are_not_noise(share: float) -> None:
    inverse_depth = slanted(SIGMA)
    cluttered = int(share * 320)
    inverse_depth[:, :cluttered] += 0.1 * (np.arange(cluttered) // 6 % 2)
    # The smoothest quarter of all windows is 83 % of those without edges.
    assert shown(inverse_depth) < 1.15 * SIGMA


def test_holes_do_not_count() -> None:
    inverse_depth = slanted(SIGMA)
    inverse_depth[np.random.default_rng(1).random(inverse_depth.shape) < 0.3] = 0
    assert shown(inverse_depth) == pytest.approx(0.93 * SIGMA, rel=0.06)


def test_what_is_too_far_does_not_count() -> None:
    inverse_depth = slanted(SIGMA)
    inverse_depth[:, :280] = 0.1 + np.random.default_rng(2).normal(0, 10 * SIGMA, (240, 280))
    assert shown(inverse_depth) > 5 * SIGMA
    assert shown(inverse_depth, 5.5) < 1.15 * SIGMA


def test_an_image_without_depth_shows_none() -> None:
    assert shown(np.zeros((240, 320))) == 0
