"""FAST corners, the edge rule and the non-maxima of [000 section 1]."""

import cv2
import numpy as np
import pytest

from vnav.features.segment_test import CIRCLE, corners, strengths

CENTRE = 6
EDGES_TOO = 16


def textured(seed: int = 0) -> np.ndarray:
    noise = cv2.GaussianBlur(np.random.default_rng(seed).uniform(0, 255, (120, 160)), (0, 0), 1.2)
    return ((noise - noise.min()) * 255 / np.ptp(noise)).astype(np.uint8)


def ring(*bright: int) -> np.ndarray:
    """Dark pixels, but for some of the circle around the centre."""
    image = np.full((13, 13), 100, np.uint8)
    for k in bright:
        x, y = CENTRE + CIRCLE[k % 16]
        image[y, x] = 160
    return image


@pytest.mark.parametrize("threshold", [10, 20, 40])
def test_corners_of_an_arc_of_nine_are_those_of_opencv(threshold: int) -> None:
    image = textured()
    detector = cv2.FastFeatureDetector.create(threshold - 1, nonmaxSuppression=False)  # above it
    wanted = {tuple(map(int, k.pt)) for k in detector.detect(image)}
    y, x = np.nonzero(strengths(image, threshold, 9, EDGES_TOO))
    assert len(wanted) > 50
    assert set(zip(x.tolist(), y.tolist(), strict=True)) == wanted


@pytest.mark.parametrize("first", range(16))
@pytest.mark.parametrize("arc", [9, 10, 11, 12])
def test_an_arc_counts_wherever_it_begins(first: int, arc: int) -> None:
    exact, short = ring(*range(first, first + arc)), ring(*range(first, first + arc - 1))
    assert strengths(exact, 50, arc, EDGES_TOO)[CENTRE, CENTRE] == arc * 60
    assert strengths(short, 50, arc, EDGES_TOO)[CENTRE, CENTRE] == 0


def test_pixels_that_are_not_side_by_side_make_no_corner() -> None:
    image = ring(*range(8), *range(9, 15))
    assert strengths(image, 50, 9, EDGES_TOO)[CENTRE, CENTRE] == 0


def test_a_dark_arc_is_a_corner_as_a_bright_one_is() -> None:
    image = 255 - ring(*range(9))
    assert strengths(image, 50, 9, EDGES_TOO)[CENTRE, CENTRE] == 9 * 60


def test_a_circle_that_mostly_looks_like_its_neighbours_lies_on_an_edge() -> None:
    # An arc of nine has two ends: 12 of 16 pixels look like both of their neighbours.
    image = ring(*range(9))
    assert strengths(image, 50, 9, 11)[CENTRE, CENTRE] == 0
    assert strengths(image, 50, 9, 12)[CENTRE, CENTRE] > 0


def test_of_neighbours_the_strongest_stays() -> None:
    image = textured(1)
    strength = strengths(image, 20, 9, EDGES_TOO)
    px, kept = corners(image, 20, 9, EDGES_TOO)
    x, y = px.astype(int).T
    around = cv2.dilate(strength, np.ones((3, 3)))
    np.testing.assert_array_equal(kept, around[y, x])
    stay = np.zeros(strength.shape, bool)
    stay[y, x] = True
    lone = (strength > 0) & (strength == around) & ~stay  # of equal neighbours the first stays
    for v, u in np.argwhere(lone):
        assert (strength[v - 1 : v + 2, u - 1 : u + 2] == strength[v, u]).sum() > 1


def test_an_image_that_is_smaller_than_the_circle_has_none() -> None:
    px, kept = corners(np.zeros((5, 4), np.uint8), 20, 9, 10)
    assert px.shape == (0, 2)
    assert not len(kept)
