from collections.abc import Callable
from types import ModuleType

import numpy as np
import pytest

from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.frame import Frame

CAMERA = Intrinsics(64, 48, 50.0, 50.0, 31.5, 23.5)


@pytest.fixture(scope="module")
def corners(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("corners")


def flat(depth_m: float) -> Frame:
    depth = np.full((48, 64), depth_m, np.float32)
    return Frame(0, 0, 0.0, np.zeros((48, 64, 3), np.uint8), depth, CAMERA)


def test_corners_are_expected_where_the_motion_puts_them(corners: ModuleType) -> None:
    # 0.2 m to the right at 2 m: 5 px to the left.
    px = np.array([[30.0, 20.0], [10.0, 40.0]])
    T_a_b = se3.make(np.eye(3), np.array([0.2, 0.0, 0.0]))
    found = corners.carried(px, flat(2.0), flat(2.0), T_a_b)
    np.testing.assert_allclose(found, px - [5, 0])


def test_what_is_out_of_sight_or_covered_is_not_expected(corners: ModuleType) -> None:
    px = np.array([[30.0, 20.0]])
    aside = se3.make(np.eye(3), np.array([2.0, 0.0, 0.0]))
    assert len(corners.carried(px, flat(2.0), flat(2.0), aside)) == 0
    assert len(corners.carried(px, flat(2.0), flat(1.5), np.eye(4))) == 0
    assert len(corners.carried(px, flat(0.0), flat(2.0), np.eye(4))) == 0


def test_places_beside_the_right_ones_tell_what_chance_finds(corners: ModuleType) -> None:
    lattice = np.stack(np.meshgrid(np.arange(0, 600, 20.0), np.arange(0, 400, 20.0)), -1)
    places = lattice.reshape(-1, 2)
    assert corners.again(places, places) == (1.0, 0.0)
    assert corners.again(places, places + 3.0)[0] == 0.0
    everywhere = np.stack(np.meshgrid(np.arange(-20, 620.0, 2), np.arange(-20, 420.0, 2)), -1)
    assert corners.again(places, everywhere.reshape(-1, 2)) == (1.0, 1.0)


def test_no_corner_is_found_again_where_there_is_none(corners: ModuleType) -> None:
    assert corners.again(np.zeros((0, 2)), np.zeros((3, 2))) == (0.0, 0.0)
