import numpy as np
import pytest

from vnav.localisation.verdict.comparison import DIFFERS, likelihoods

ROWS, COLUMNS = 12, 16


@pytest.fixture
def explained() -> np.ndarray:
    """Three places that explain every cell of a photo."""
    return np.zeros((3, ROWS, COLUMNS))


def leave_open(shares: np.ndarray, places: list[int], cells: int, first: int = 0) -> None:
    """Most pixels of some cells are not as places show them."""
    shares.reshape(len(shares), -1)[places, first : first + cells] = 3 * DIFFERS


def test_places_that_explain_the_same_stay_as_likely_as_they_were(explained):
    leave_open(explained, [0, 1, 2], 4)
    np.testing.assert_allclose(likelihoods(explained)[:3], 1)


def test_a_place_that_explains_what_the_others_do_not_is_likelier(explained):
    leave_open(explained, [0], 8)
    leave_open(explained, [2], 8, first=20)
    found = likelihoods(explained)
    assert found[1] == 1
    assert found[[0, 2]].max() < 1e-3


def test_a_cell_that_another_place_explains_takes_more_than_one_that_tells_gives(explained):
    leave_open(explained, [0], 8)
    before = likelihoods(explained[:2])[0]
    leave_open(explained, [1], 1, first=40)
    assert likelihoods(explained[:2])[0] > 10 * before


def test_a_photo_of_which_no_place_explains_as_much_as_tells_them_apart_is_from_elsewhere(
    explained,
):
    leave_open(explained, [0], 10)
    leave_open(explained, [0, 1, 2], 10, first=60)
    assert likelihoods(explained[:2])[-1] > 100


def test_a_photo_that_the_best_place_explains_whole_is_hardly_from_elsewhere(explained):
    leave_open(explained, [1, 2], 10)
    assert likelihoods(explained)[-1] < 0.05


def test_what_no_place_tells_leaves_open_whether_the_photo_is_from_elsewhere(explained):
    assert likelihoods(explained)[-1] == 1


def test_cells_of_which_nothing_is_shown_tell_nothing(explained):
    leave_open(explained, [0], 8)
    before = likelihoods(explained)
    explained[:, 6:] = np.nan
    np.testing.assert_array_equal(likelihoods(explained), before)
