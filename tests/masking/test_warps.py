"""Where blocks were in the frame before."""

import numpy as np
import pytest

from tests.masking.moving_box import CAMERA, walk
from vnav.core import se3
from vnav.core.reduced_frame import ReducedFrame
from vnav.masking.warps import by_depth, by_homography

ROWS, COLUMNS = np.indices((CAMERA.height, CAMERA.width))


def textured(shift: int, inverse_depth: float = 0.5) -> ReducedFrame:
    """Part of a picture of blobs, further to the right by so many blocks."""
    noise = np.random.default_rng(0).uniform(0, 255, (CAMERA.height // 4, 40))
    picture = np.repeat(np.repeat(noise, 4, 0), 4, 1)
    grey = picture[:, shift : shift + CAMERA.width]
    return ReducedFrame(0.0, grey, np.full(grey.shape, inverse_depth), CAMERA)


def test_a_step_aside_shifts_a_wall_by_its_parallax() -> None:
    frames = walk(0.2, None).frames
    places = by_depth(frames[0], frames[1], se3.make(np.eye(3), [0.3, 0, 0]))
    shift = places - np.stack([COLUMNS, ROWS], -1)
    assert np.allclose(shift, [CAMERA.fx * 0.3 / 3.0, 0], atol=0.15)  # noise of 0.5 % in depth


def test_without_depth_a_turn_shifts_the_image_and_a_step_does_not() -> None:
    blind = textured(0, inverse_depth=0.0)
    step = by_depth(blind, blind, se3.make(np.eye(3), [0.3, 0, 0]))
    turn = by_depth(blind, blind, se3.make(se3.exp_so3([0, 0.02, 0]), [0, 0, 0]))
    assert np.allclose(step, np.stack([COLUMNS, ROWS], -1), atol=1e-4)
    assert (turn - step)[30, 40, 0] == pytest.approx(CAMERA.fx * 0.02, rel=0.01)


def test_a_surface_that_something_hid_has_no_place() -> None:
    before, now = walk(0.1, lambda _: 0.0).frames[0], walk(0.1, None).frames[0]
    assert np.isnan(by_depth(before, now, np.eye(4))[30, 40]).all()


def test_a_homography_is_found_by_tracked_corners() -> None:
    places = by_homography(textured(0), textured(3), np.eye(4))
    assert places is not None
    off = places[10:50, 10:70] - np.stack([COLUMNS + 3, ROWS], -1)[10:50, 10:70]
    assert np.abs(off).max() < 0.75


def test_a_blank_image_gives_no_homography() -> None:
    blank = ReducedFrame(0.0, np.full(ROWS.shape, 90.0), np.full(ROWS.shape, 0.5), CAMERA)
    assert by_homography(blank, blank, np.eye(4)) is None
