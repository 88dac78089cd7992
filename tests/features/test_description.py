"""Features of frames."""

import dataclasses

import numpy as np
import pytest

from vnav.config import Config
from vnav.core.camera import Intrinsics
from vnav.core.frame import Frame
from vnav.features.description import FrameDescriber

CAMERA = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)


@pytest.mark.parametrize("how", ["describe", "describe_coarsely"])
def test_no_feature_lies_on_what_hides_the_scene(how: str) -> None:
    color = np.random.default_rng(0).integers(0, 256, (480, 640, 3), dtype=np.uint8)
    shown = Frame(0, 0, 1.0, color, np.full((480, 640), 2.0), CAMERA)
    hidden = np.zeros((480, 640), bool)
    hidden[:, 400:] = True

    describe = getattr(FrameDescriber(Config()), how)
    columns = [
        describe(0, frame).features.keypoints_px[:, 0]
        for frame in (shown, dataclasses.replace(shown, hidden=hidden))
    ]

    assert columns[0].max() > 600
    np.testing.assert_array_equal(columns[0][np.rint(columns[0]) < 400], columns[1])
