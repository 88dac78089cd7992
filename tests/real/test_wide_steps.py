"""Two frames of house that are 0.3 s apart, before a window: too few features, all pixels."""

from pathlib import Path

import numpy as np
import pytest

from vnav.config import Config
from vnav.core import se3
from vnav.io.formats.trajectories import read_tum
from vnav.io.sources.open_capture import open_capture
from vnav.registration.dense import DenseEstimate, align

pytestmark = pytest.mark.real

BEFORE, LAST, NEXT = 294, 295, 298  # the camera turns by 4 degrees from frame to frame


def test_the_bars_of_a_window_are_found_from_beside_a_minimum_that_is_not_the_least(
    captures: Path,
) -> None:
    """The prediction is 6 cm off; the nearest minimum, 8 cm from the truth, seems well known."""
    config = Config()
    house = open_capture(captures / "house", config.capture)
    true = read_tum(captures / "house" / "groundtruth.txt")
    rows = [np.abs(true.stamps_s - house.stamps_s[k]).argmin() for k in (BEFORE, LAST, NEXT)]
    T_before, T_last, T_next = true.T_world_camera[rows]
    step, motion = se3.inverse(T_before) @ T_last, se3.inverse(T_last) @ T_next
    last, following = house.read(LAST), house.read(NEXT)

    found = align(last, following, house.camera.color, config.registration, step @ step @ step)

    assert isinstance(found, DenseEstimate)
    off = se3.inverse(motion) @ found.T_a_b
    assert np.linalg.norm(off[:3, 3]) < 0.003  # seven of its standard deviations
