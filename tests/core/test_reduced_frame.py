"""Frames in blocks of pixels."""

import numpy as np

from vnav.core.reduced_frame import blocks_of, in_pixels


def test_blocks_are_the_pixels_they_were_made_of() -> None:
    blocks = np.zeros((12, 16), bool)
    blocks[2, 3] = True
    pixels = in_pixels(blocks, (50, 67))  # two rows and three columns are left over

    assert np.array_equal(np.argwhere(pixels).min(0), [8, 12])
    assert pixels.sum() == 16
    on = np.array([[12.0, 8.0], [15.4, 11.4], [16.0, 8.0], [66.0, 49.0]], np.float32)
    assert blocks_of(blocks, on, (64, 48)).tolist() == [True, True, False, False]
