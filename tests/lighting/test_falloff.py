"""The profile of light, from points whose brightness is known exactly."""

import numpy as np
import pytest

from tests.lighting.lamp import lamp
from vnav.lighting.falloff import DEGREE, LightProfile, fitted
from vnav.lighting.followed_points import Changes

R2 = np.linspace(0, 1, 11)
NOISE = 0.01  # of a logarithm of brightness


def place(seed: int, light=lamp, outliers: int = 0, exposure: float = 0.3) -> list[Changes]:
    """Two pairs of frames: 100 points each somewhere in both."""
    rng = np.random.default_rng(seed)
    pairs = []
    for _ in range(2):
        a, b = rng.uniform(0, 1, (2, 100))
        change = np.log(light(b) / light(a)) + exposure * rng.standard_normal()
        change += NOISE * rng.standard_normal(100)
        change[:outliers] += 1.5
        pairs.append(Changes(a, b, a, b, change))
    return pairs


def off(profile: LightProfile, light=lamp) -> np.ndarray:
    """Errors of the logarithm, in standard deviations."""
    return np.log(profile.brightness(R2[1:]) / light(R2[1:])) / [profile.sigma(r2) for r2 in R2[1:]]


def exact(r2: np.ndarray) -> np.ndarray:
    """A profile of the family that is fitted."""
    return LightProfile(np.array([0.5, 0.3, 0.2, 0.1, 0.1]), np.eye(DEGREE)).brightness(r2)


def test_a_profile_is_found_as_surely_as_it_says() -> None:
    # Errors of variance 1 at 10 distances, 3 of them independent: of 20 captures the mean square is
    # 1 +- sqrt(2 / 60), and the jackknife of 10 places errs by a half in each.
    errors = [off(fitted([place(10 * k + j, exact) for j in range(10)]), exact) for k in range(20)]
    assert 0.5 < np.mean(np.square(errors)) < 1.7
    assert np.abs(errors).max() < 5


def test_a_lamps_profile_is_within_a_percent_although_no_polynomial() -> None:
    profile = fitted([place(k) for k in range(24)])
    assert profile is not None
    # 4800 points of 1 % noise: 0.1 % in the middle; the rest is what the family cannot follow
    assert np.abs(np.log(profile.brightness(R2) / lamp(R2))).max() < 0.01


def test_points_on_what_changes_its_brightness_do_not_count() -> None:
    profile = fitted([place(k, exact, outliers=20) for k in range(12)])
    assert profile is not None
    assert np.abs(np.log(profile.brightness(R2) / exact(R2))).max() < 0.01  # as without them


def test_light_never_rises_outwards() -> None:
    profile = fitted([place(k, lambda r2: 1 + 0.5 * r2) for k in range(12)])
    assert profile is not None
    np.testing.assert_allclose(profile.brightness(R2), 1, atol=1e-6)
    assert not profile.is_strong


def test_too_few_places_tell_nothing() -> None:
    assert fitted([place(k) for k in range(7)] + [[]] * 5) is None
    assert fitted([place(k) for k in range(8)]) is not None


def test_points_that_stay_where_they_are_tell_of_no_falloff() -> None:
    still = np.linspace(0, 1, 50)
    profile = fitted([[Changes(still, still, still, still, np.zeros(50))]] * 10)
    assert profile is not None
    assert not profile.is_strong


@pytest.mark.parametrize(
    ("left", "sigma", "strong"), [(0.7, 0.01, True), (0.7, 0.1, False), (0.9, 0.001, False)]
)
def test_what_is_taken_off_is_strong_and_sure(left: float, sigma: float, strong: bool) -> None:
    profile = LightProfile(np.zeros(DEGREE), np.zeros((DEGREE, DEGREE)))
    reached = 1 - (1 - 0.75**2) ** DEGREE  # of the first drop, three quarters of the way out
    drops, covariance = profile.drops.copy(), profile.covariance.copy()
    drops[0], covariance[0, 0] = -np.log(left) / reached, (sigma / reached) ** 2
    assert LightProfile(drops, covariance).is_strong is strong
