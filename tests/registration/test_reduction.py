"""Frames reduced to blocks of pixels."""

import dataclasses

import numpy as np

from vnav.core.camera import Intrinsics
from vnav.core.frame import Frame
from vnav.core.reduced_frame import BLOCK_PX
from vnav.registration.reduction import reduced

CAMERA = Intrinsics(64, 48, 60.0, 60.0, 31.5, 23.5)


def frame_of(depth_m: np.ndarray, grey: int = 100) -> Frame:
    color = np.full((*depth_m.shape, 3), grey, np.uint8)
    return Frame(0, 0, 1.0, color, depth_m.astype(np.float32), CAMERA)


def test_a_point_has_the_same_ray_in_the_small_image_as_in_the_large_one() -> None:
    small = reduced(frame_of(np.full((48, 64), 2.0)))
    point = np.array([[0.3, -0.2, 2.0]])

    px, small_px = CAMERA.project(point), small.intrinsics.project(point)

    assert np.allclose((px + 0.5) / BLOCK_PX - 0.5, small_px)


def test_the_inverse_depth_of_a_plane_is_that_at_the_middle_of_a_block() -> None:
    inverse = 0.5 + 0.001 * np.arange(64)[None, :] + 0.0 * np.arange(48)[:, None]

    small = reduced(frame_of(1 / inverse))

    middle = BLOCK_PX * np.arange(16) + (BLOCK_PX - 1) / 2
    assert np.allclose(small.inverse_depth, 0.5 + 0.001 * middle, atol=1e-6)


def test_a_block_on_a_depth_edge_has_no_depth() -> None:
    depth_m = np.full((48, 64), 2.0)
    depth_m[:, 30:] = 3.0

    small = reduced(frame_of(depth_m))

    at_edge = small.inverse_depth[:, 30 // BLOCK_PX]
    assert not at_edge.any()
    assert (np.delete(small.inverse_depth, 30 // BLOCK_PX, 1) > 0).all()


def test_a_block_with_little_depth_has_none() -> None:
    depth_m = np.zeros((48, 64))
    depth_m[::BLOCK_PX, ::2] = 2.0  # one pixel of eight

    assert not reduced(frame_of(depth_m)).inverse_depth.any()


def test_brightness_is_a_blocks_mean() -> None:
    assert np.allclose(reduced(frame_of(np.zeros((48, 64)), 80)).grey, 80, atol=1e-3)


def test_a_block_with_a_hidden_pixel_is_masked() -> None:
    hidden = np.zeros((48, 64), bool)
    hidden[9, 30] = True

    small = reduced(dataclasses.replace(frame_of(np.full((48, 64), 2.0)), hidden=hidden))

    assert small.masked is not None
    assert np.argwhere(small.masked).tolist() == [[9 // BLOCK_PX, 30 // BLOCK_PX]]
    np.testing.assert_array_equal(small.inverse_depth == 0, small.masked)
