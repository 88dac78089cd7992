from pathlib import Path

import numpy as np

from vnav.io.sources.frame_list import FrameList, FramePair, ImageFile, paired


def images(stamps: list[float], kind: str) -> list[ImageFile]:
    return [ImageFile(stamp, Path(f"{kind}/{k}.png")) for k, stamp in enumerate(stamps)]


def test_frames_are_in_order_of_time_and_what_is_left_is_dropped() -> None:
    colors, depths = images([2.0, 1.0, 3.0], "rgb"), images([1.01, 2.01, 9.0], "depth")
    frames = paired(colors, depths, np.array([[0, 1], [1, 0]]))
    assert frames.stamps_s.tolist() == [1.0, 2.0]
    assert [pair.depth.stamp_s for pair in frames.pairs] == [1.01, 2.01]
    assert frames.dropped_color == (colors[2],)
    assert frames.dropped_depth == (depths[2],)


def test_of_two_colour_images_with_one_time_the_first_is_kept() -> None:
    colors, depths = images([1.0, 1.0], "rgb"), images([1.0, 1.001], "depth")
    frames = paired(colors, depths, np.array([[0, 0], [1, 1]]))
    assert frames.pairs == (FramePair(colors[0], depths[0]),)
    assert frames.dropped_color == (colors[1],)


def test_an_offset_is_how_much_later_depth_was_taken() -> None:
    colors, depths = images([0.0, 0.1, 0.5], "rgb"), images([0.01, 0.1, 0.48], "depth")
    frames = FrameList(tuple(map(FramePair, colors, depths)))
    np.testing.assert_allclose(frames.offsets_s, [0.01, 0.0, -0.02], atol=1e-12)
