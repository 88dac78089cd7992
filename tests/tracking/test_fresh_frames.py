"""Frames of which one image comes twice."""

import dataclasses

import numpy as np
import pytest

from vnav.core.frame import Frame
from vnav.tracking.fresh_frames import FreshFrames


def reasons(frames: list[Frame]) -> list[str]:
    fresh = FreshFrames()
    return [fresh.repeated(frame) for frame in frames]


def test_frames_of_a_video_are_fresh(frames: list[Frame]) -> None:
    assert reasons(frames) == [""] * len(frames)


@pytest.mark.parametrize(("kind", "name"), [("color", "colour"), ("depth_m", "depth")])
def test_a_frame_that_has_one_image_of_the_frame_before_is_not(
    frames: list[Frame], kind: str, name: str
) -> None:
    stale = dataclasses.replace(frames[1], **{kind: getattr(frames[0], kind)})
    found = reasons([frames[0], stale, frames[2]])
    assert found[::2] == ["", ""]
    assert found[1].startswith(f"its {name} image is that of the frame before")


def test_an_image_that_comes_three_times_is_stale_twice(frames: list[Frame]) -> None:
    stale = [dataclasses.replace(f, color=frames[0].color) for f in frames[:3]]
    assert [bool(reason) for reason in reasons(stale)] == [False, True, True]


def test_a_still_scene_without_noise_is_fresh(frames: list[Frame]) -> None:
    assert reasons([frames[0]] * 3) == [""] * 3


def test_frames_without_depth_are_not_told_apart_by_it(frames: list[Frame]) -> None:
    blind = [dataclasses.replace(f, depth_m=np.zeros_like(f.depth_m)) for f in frames[:3]]
    assert reasons(blind) == [""] * 3


def test_a_change_of_one_pixel_makes_an_image_fresh(frames: list[Frame]) -> None:
    color = frames[0].color.copy()
    color[7, 7, 0] ^= 1
    other = dataclasses.replace(frames[1], color=color)
    assert reasons([frames[0], other]) == ["", ""]
