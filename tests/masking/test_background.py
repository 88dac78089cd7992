"""Two Gaussians of brightness a block, held against values computed by hand."""

import numpy as np
import pytest

from vnav.masking.background import FIRST_VARIANCE, MIN_VARIANCE, Background

SHAPE = (2, 3)


def grey(value: float) -> np.ndarray:
    return np.full(SHAPE, value, np.float32)


def after(*values: float) -> np.ndarray:
    """Mean, variance and age of the two models of one block that had these values."""
    background = Background.unknown(SHAPE)
    for value in values:
        background = background.updated(grey(value))
    return background.models[:, :, 0, 0]


def of_models(mean: np.ndarray, variance: float, age: float) -> Background:
    models = np.zeros((2, 3, *mean.shape), np.float32)
    models[:, 0], models[:, 1], models[:, 2] = mean, variance, age
    return Background(models)


def at(columns: np.ndarray, rows: np.ndarray) -> np.ndarray:
    return np.stack([columns, rows], -1).astype(np.float32)


def test_the_first_value_starts_the_background() -> None:
    assert after(100).tolist() == [[100, FIRST_VARIANCE, 1], [0, FIRST_VARIANCE, 0]]


def test_a_value_that_fits_moves_mean_and_variance_by_the_age() -> None:
    # a = 1/2: mean (100 + 110) / 2, variance (400 + 5^2) / 2; then a = 2/3
    assert after(100, 110)[0] == pytest.approx([105, 212.5, 2])
    mean = 2 / 3 * 105 + 99 / 3
    assert after(100, 110, 99)[0] == pytest.approx(
        [mean, 2 / 3 * 212.5 + (99 - mean) ** 2 / 3, 3], rel=1e-5
    )


def test_variance_has_a_floor_and_age_a_ceiling() -> None:
    assert after(*[100] * 60)[0].tolist() == [100, MIN_VARIANCE, 30]


def test_a_value_that_fits_neither_model_starts_the_candidate() -> None:
    background, candidate = after(100, 100, 200)
    assert background.tolist() == [100, 200, 2]
    assert candidate.tolist() == [200, FIRST_VARIANCE, 1]


def test_an_older_candidate_becomes_the_background() -> None:
    background, candidate = after(100, 100, 200, 200, 200)
    assert background[[0, 2]].tolist() == [200, 3]
    assert candidate[2] == 0


def test_a_block_between_two_mixes_them_and_their_difference() -> None:
    mean = np.array([[100.0, 120.0, 100.0]])
    mixed = of_models(mean, 50, 8).warped(at(np.full((1, 3), 0.25), np.zeros((1, 3)))).models
    # weights 3/4 and 1/4: mean 105, variance 50 + 3/4 5^2 + 1/4 15^2
    assert mixed[0, :, 0, 0] == pytest.approx([105, 50 + 75, 8], rel=1e-4)


def test_a_mixture_of_what_differs_much_ages() -> None:
    mean = np.array([[0.0, 200.0, 0.0]])
    mixed = of_models(mean, 50, 8).warped(at(np.full((1, 3), 0.5), np.zeros((1, 3)))).models
    variance = 50 + 100**2
    age = 8 * np.exp(-0.001 * (variance - 50**2))
    assert mixed[0, :, 0, 0] == pytest.approx([100, variance, age], rel=1e-4)


@pytest.mark.parametrize("place", [np.nan, -3.0, 7.0])
def test_a_block_that_was_not_seen_has_age_zero(place: float) -> None:
    mixed = of_models(grey(100), 50, 8).warped(at(np.full(SHAPE, place), np.zeros(SHAPE))).models
    assert (mixed[:, 2] == 0).all()
    assert (mixed[:, 1] == FIRST_VARIANCE).all()


def test_a_block_half_outside_the_image_is_half_as_old() -> None:
    mixed = of_models(grey(100), 50, 8).warped(at(np.full(SHAPE, -0.5), np.zeros(SHAPE))).models
    assert mixed[0, :, 0, 0] == pytest.approx([100, 50, 4], rel=1e-4)


def test_a_block_differs_only_beyond_two_deviations_and_where_its_neighbours_do() -> None:
    known = of_models(np.full((5, 5), 100.0), 25, 8)
    image = np.full((5, 5), 109.0, np.float32)
    assert not known.differs(image).any()
    image[:] = 111
    assert known.differs(image).all()
    image[2, 2] = 100
    assert not known.differs(image)[1:4, 1:4].any()


def test_exposure_is_taken_off() -> None:
    known = of_models(np.linspace(60, 120, 25).reshape(5, 5), 25, 8)
    darker = 0.5 * known.models[0, 0]
    assert known.differs(darker).any()
    assert not known.adapted(darker).differs(darker).any()
