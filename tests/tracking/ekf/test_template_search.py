"""Templates in images of speckle, whose places are known."""

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from vnav.core.arrays import Array
from vnav.tracking.correlation import TEMPLATE_PX, correlation
from vnav.tracking.ekf.template_search import MAX_SEARCH_PX, search

Image = NDArray[np.uint8]
HALF = TEMPLATE_PX // 2
WIDE = 100.0 * np.eye(2)  # covariance: an ellipse of 30 px


@pytest.fixture(scope="module")
def image() -> Image:
    rng = np.random.default_rng(0)
    grey = cv2.GaussianBlur(rng.standard_normal((120, 160)), (0, 0), 1.5)
    return np.clip(128 + 250 * grey, 0, 255).astype(np.uint8)


def around(image: Image, u: int, v: int) -> Array:
    return image[v - HALF : v + HALF + 1, u - HALF : u + HALF + 1].astype(float)


def find(image: Image, template: Array, at: tuple[float, float], S: Array = WIDE) -> Array:
    return np.asarray(search(image, template[None], np.array([at], float), S[None])[0])


def test_a_template_is_found_where_it_is_from(image: Image) -> None:
    # the parabola of a symmetric peak is right, that of speckle within a fifth of a pixel
    assert find(image, around(image, 80, 60), (70, 65)) == pytest.approx([80, 60], abs=0.2)


def test_gain_and_offset_of_brightness_do_not_matter(image: Image) -> None:
    template = around(image, 80, 60)
    same = find(image, template, (75, 60))
    assert find(image, 0.3 * template + 50, (75, 60)) == pytest.approx(same, abs=1e-6)


def test_a_shift_of_a_fraction_of_a_pixel_is_found(image: Image) -> None:
    shift = np.array([0.4, -0.3])
    M = np.array([[1, 0, shift[0]], [0, 1, shift[1]]])
    moved = cv2.warpAffine(image, M, image.shape[::-1], flags=cv2.INTER_CUBIC)
    off = [
        find(np.asarray(moved), around(image, u, v), (u, v)) - (u, v) - shift
        for u in range(30, 130, 20)
        for v in range(30, 90, 20)
    ]
    # half a grain of 1.5 px is a peak that a parabola follows to a tenth of a pixel
    assert np.abs(off).mean() < 0.1


def test_nothing_is_sought_outside_the_ellipse_or_too_far(image: Image) -> None:
    template = around(image, 80, 60)
    narrow = np.diag([100.0, 1.0])
    assert np.isfinite(find(image, template, (60, 61), narrow)).all()
    assert np.isnan(find(image, template, (80, 50), narrow)).all()
    assert np.isnan(find(image, template, (80 - MAX_SEARCH_PX - 2, 60), 1e6 * np.eye(2))).all()


def test_without_contrast_there_is_no_match(image: Image) -> None:
    flat = np.full((TEMPLATE_PX, TEMPLATE_PX), 128.0)
    assert np.isnan(find(image, flat, (80, 60))).all()
    grey = np.full_like(image, 128)
    assert np.isnan(find(grey, around(image, 80, 60), (80, 60))).all()


def test_what_looks_otherwise_is_no_match(image: Image) -> None:
    assert np.isnan(find(image, -around(image, 80, 60), (80, 60), np.eye(2))).all()


def test_a_template_that_is_not_known_is_no_match(image: Image) -> None:
    assert np.isnan(find(image, np.full((TEMPLATE_PX, TEMPLATE_PX), np.nan), (80, 60))).all()


def test_the_correlation_is_that_of_the_formula(image: Image) -> None:
    """[000 eq 4] with its root."""
    f0, f1 = around(image, 80, 60), around(image, 83, 58)
    a, b = f0 - f0.mean(), f1 - f1.mean()
    expected = (a * b).sum() / np.sqrt((a**2).sum() * (b**2).sum())
    unit = a / np.sqrt((a**2).sum())
    assert correlation(image, unit, 83, 58) == pytest.approx(expected, abs=1e-6)
    assert correlation(image, unit, 3, 58) == -1  # beyond the edge of the image
