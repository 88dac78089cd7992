import numpy as np
import pytest

from vnav.core.arrays import frozen


def test_a_frozen_array_is_read_only_and_the_given_one_is_not() -> None:
    given = np.zeros((2, 3))
    result = frozen(given, np.float64, (2, 3))
    with pytest.raises(ValueError, match="read-only"):
        result[0] = 1
    given[0] = 1


def test_values_take_the_type_asked_for() -> None:
    assert frozen([[1, 2]], np.float32, (1, 2)).dtype == np.float32


def test_none_fits_any_length() -> None:
    assert frozen(np.zeros((0, 3)), np.float64, (None, 3)).shape == (0, 3)


@pytest.mark.parametrize("shape", [(3, 2), (2,), (2, 3, 1), (None, 4)])
def test_another_shape_is_refused(shape: tuple[int | None, ...]) -> None:
    with pytest.raises(ValueError, match="expected an array of shape"):
        frozen(np.zeros((2, 3)), np.float64, shape)
