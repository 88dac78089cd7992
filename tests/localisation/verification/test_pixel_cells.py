import numpy as np
import pytest

from vnav.localisation.verification.pixel_cells import CELL_PX, NOISE, SMOOTH, misfits, noise

HEIGHT, WIDTH = 60, 80
SIGMA = np.full(3, 1.5)


@pytest.fixture
def plain() -> np.ndarray:
    """A plain surface of one colour."""
    return np.full((HEIGHT, WIDTH, 3), (90.0, 120.0, 150.0), np.float32)


@pytest.fixture
def books() -> np.ndarray:
    """Upright stripes of many colours, 5 pixels wide."""
    colors = np.random.default_rng(0).uniform(20, 220, (WIDTH // 5, 3))
    return np.tile(np.repeat(colors, 5, 0), (HEIGHT, 1, 1)).astype(np.float32)


def test_what_is_shown_as_it_is_differs_nowhere(books):
    assert (misfits(books, books, SIGMA) == 0).all()


def test_what_lies_a_pixel_off_does_not_differ(books):
    """Edges never lie quite where they should."""
    assert (misfits(np.roll(books, 1, axis=1), books, SIGMA)[:, 1:] == 0).all()


def test_a_thin_line_that_one_image_lacks_does_not_differ(plain):
    """The photo's line is a pixel away from what the view shows there, and has no area."""
    lined = plain.copy()
    lined[:, ::CELL_PX] += 60
    found = misfits(lined, plain, SIGMA)
    assert (found <= 1 / CELL_PX + 1e-9).all()


def test_a_patch_of_another_colour_differs_in_its_cells_alone(plain):
    other = plain.copy()
    other[2 * CELL_PX : 3 * CELL_PX, 4 * CELL_PX : 5 * CELL_PX, 1] += 20
    found = misfits(other, plain, SIGMA)
    assert found[2, 4] > 0.6  # the pixels at its edge have the surface's colour beside them
    found[2, 4] = 0
    assert (found == 0).all()


def test_noise_does_not_differ(plain):
    rng = np.random.default_rng(0)
    noisy = (plain + rng.normal(0, SIGMA[0], plain.shape)).astype(np.float32)
    assert np.nanmax(misfits(noisy, plain, SIGMA)) < 0.02


def test_a_cell_of_which_little_is_shown_tells_nothing(plain):
    view = plain.copy()
    view[:CELL_PX, : int(0.6 * CELL_PX)] = np.nan
    view[:CELL_PX, CELL_PX : CELL_PX + int(0.4 * CELL_PX)] = np.nan
    found = misfits(plain, view, SIGMA)
    assert np.isnan(found[0, 0])
    assert found[0, 1] == 0


def test_plain_surfaces_tell_the_noise(plain, books):
    """Half of the image is books that lie a pixel off, which do not."""
    rng, sigma = np.random.default_rng(0), 1.6
    view = plain.copy()
    view[:, : WIDTH // 2] = books[:, : WIDTH // 2]
    photo = view.copy()
    photo[:, : WIDTH // 2] = np.roll(books, 1, axis=1)[:, : WIDTH // 2]
    photo += rng.normal(0, sigma, view.shape)
    found = noise(photo.astype(np.float32), [view])
    smoothest = SMOOTH * HEIGHT * WIDTH  # whose range, and so whose noise, is a little less
    np.testing.assert_allclose(found, sigma, rtol=0.1 + 5 / np.sqrt(smoothest))


def test_the_view_that_fits_best_tells_the_noise(plain):
    rng, sigma = np.random.default_rng(0), 1.6
    photo = (plain + rng.normal(0, sigma, plain.shape)).astype(np.float32)
    np.testing.assert_array_equal(noise(photo, [plain, plain + 30]), noise(photo, [plain]))


@pytest.mark.parametrize(("off", "expected"), [(0.0, NOISE[0]), (30.0, NOISE[1])])
def test_noise_is_no_less_and_no_more_than_light_and_sensor_account_for(plain, off, expected):
    assert (noise(plain, [plain + np.float32(off)]) == expected).all()


def test_a_view_that_shows_nothing_tells_no_noise(plain):
    assert (noise(plain, [np.full_like(plain, np.nan)]) == NOISE[1]).all()
