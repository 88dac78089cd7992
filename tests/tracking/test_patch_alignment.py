"""Patches of a smooth texture, moved, warped and brightened by a known amount."""

import numpy as np
import pytest

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.tracking.patch_alignment import affine_warp, align_patches

CAMERA = Intrinsics(160, 120, 131.0, 132.0, 79.5, 59.5)
STRAIGHT = np.eye(2)
PLACES = np.array([[u, v] for u in range(30, 131, 20) for v in range(30, 91, 20)], float)
WAVES = np.random.default_rng(0).uniform(-0.5, 0.5, (12, 2))  # rad a pixel
PHASES = np.random.default_rng(1).uniform(0, 2 * np.pi, 12)


def texture(px: Array) -> Array:
    """Grey levels (...) of a texture without end at pixels (..., 2)."""
    return np.asarray(120 + 12 * np.sin(px @ WAVES.T + PHASES).sum(-1))


def image(A: Array = STRAIGHT, shift_px: Array | None = None, seed: int | None = None) -> Array:
    """The texture, as moved by ``x -> A x + shift``, with noise of two grey levels or none."""
    px = np.stack(np.meshgrid(np.arange(160.0), np.arange(120.0)), -1)
    shown = texture((px - (0 if shift_px is None else shift_px)) @ np.linalg.inv(A).T)
    return shown if seed is None else shown + np.random.default_rng(seed).normal(0, 2, shown.shape)


def aligned(a: Array, b: Array, start_px: Array, A: Array = STRAIGHT, gain: float = 1.0) -> Array:
    return align_patches(a, b, PLACES, start_px, np.tile(A, (len(PLACES), 1, 1)), gain)


@pytest.mark.parametrize("offset", [0.0, 30.0])
def test_a_shift_is_found_whatever_the_offset_of_brightness(offset: float) -> None:
    # Noise of 2 grey levels in both, 64 pixels with gradients of some 6 grey levels a pixel:
    # 2 * sqrt(2 / 64) / 6 = 0.06 px in each patch, and 0.012 px in the mean of 24.
    shift = np.array([1.37, -0.82])
    found = aligned(image(seed=2), image(shift_px=shift, seed=3) + offset, PLACES)
    off = found - PLACES - shift
    assert np.isfinite(off).all(1).mean() > 0.9
    assert np.abs(np.nanmean(off, 0)).max() < 0.05
    assert np.nanstd(off, 0).max() < 0.15


def test_a_brighter_image_is_matched_by_its_gain() -> None:
    shift = np.array([-0.6, 0.9])
    found = aligned(image(), 1.8 * image(shift_px=shift) - 40, PLACES, gain=1.8)
    np.testing.assert_allclose(found - PLACES, np.tile(shift, (len(PLACES), 1)), atol=0.05)


def test_a_patch_is_warped_before_it_is_sought() -> None:
    turned = 1.2 * np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    middle = np.array([79.5, 59.5])
    shift = middle - turned @ middle
    true_px = PLACES @ turned.T + shift
    inside = ((true_px > 20) & (true_px < [139, 99])).all(1)
    b = image(turned, shift)
    found = aligned(image(), b, true_px + 0.5, turned)[inside]
    # It ends with a step of 0.03 px; linear interpolation of either image adds as much.
    np.testing.assert_allclose(found, true_px[inside], atol=0.1)
    unwarped = aligned(image(), b, true_px + 0.5)[inside]
    right = np.abs(unwarped - true_px[inside]).max(1) < 0.1
    assert right.mean() < 0.5


def test_what_has_no_corner_is_not_found() -> None:
    px = np.stack(np.meshgrid(np.arange(160.0), np.arange(120.0)), -1)
    stripes = 120 + 60 * np.sin(px[..., 0] * 0.4)
    assert np.isnan(aligned(stripes, stripes, PLACES)).all()
    assert np.isnan(aligned(np.full((120, 160), 90.0), stripes, PLACES)).all()


def test_another_texture_is_not_taken_for_the_patch() -> None:
    # Of 64 pixels that three parameters fit, few correlate by 0.8 with anything else.
    found = aligned(image(), image()[::-1, ::-1].copy(), PLACES)
    assert np.isfinite(found[:, 0]).mean() < 0.2


def test_a_patch_beyond_the_border_is_not_found() -> None:
    assert np.isnan(aligned(image(), image(), PLACES - [200, 0])).all()


def test_no_patches_are_found_of_none() -> None:
    none = np.zeros((0, 2))
    assert align_patches(image(), image(), none, none, np.zeros((0, 2, 2)), 1.0).shape == (0, 2)


def test_the_warp_of_a_slanted_plane_is_the_derivative_of_its_projection() -> None:
    normal, distance_m = np.array([0.5, -0.2, 1.0]), 1.5  # n x = d
    T_b_a = se3.exp([0.1, -0.25, 0.3, 0.2, -0.1, 0.15])

    def in_b(px: Array) -> Array:
        rays = CAMERA.unproject(px, np.ones(len(px)))
        return CAMERA.project(se3.transform(T_b_a, rays * (distance_m / (rays @ normal))[:, None]))

    slopes = normal[:2] / [CAMERA.fx, CAMERA.fy] / distance_m
    inverse_depth = CAMERA.unproject(PLACES, np.ones(len(PLACES))) @ normal / distance_m
    surface = np.column_stack([inverse_depth, np.tile(slopes, (len(PLACES), 1))])
    step = 1e-4
    moved = [(in_b(PLACES + d) - in_b(PLACES - d)) / (2 * step) for d in step * np.eye(2)]
    warp = affine_warp(T_b_a, PLACES, surface, CAMERA)
    np.testing.assert_allclose(warp, np.stack(moved, -1), atol=1e-6)
