from collections.abc import Callable
from types import ModuleType

import numpy as np
import pytest

from vnav.synthetic import SCENES, Box


@pytest.fixture(scope="module")
def moved(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("moved_furniture")


def test_a_distance_to_a_turned_box_is_that_to_its_surface(moved: ModuleType) -> None:
    box = Box((1.0, 2.0, 0.5), (2.0, 0.2, 1.0), np.pi / 2, "wood")
    points = np.array([[1.0, 2.0, 0.5], [1.5, 2.0, 0.5], [1.0, 3.3, 0.5], [1.4, 2.0, 1.4]])
    np.testing.assert_allclose(moved.distance(points, [box]), [0, 0.4, 0.3, 0.5])


def test_the_surface_of_a_box_has_points_on_all_its_faces(moved: ModuleType) -> None:
    box = Box((1.0, 2.0, 0.5), (0.4, 0.2, 1.0), 0.3, "wood")
    own = np.abs((moved.surface([box]) - box.centre) @ box.R_world_box) * 2 / box.size
    np.testing.assert_allclose(own.max(1), 1)
    area_m2 = 2 * (0.4 * 0.2 + 0.4 * 1.0 + 0.2 * 1.0)
    assert len(own) == pytest.approx(area_m2 / moved.LATTICE_M**2)


def test_chair_box_and_door_leave_and_chair_and_door_come(moved: ModuleType) -> None:
    before, after = (SCENES[f"room_{state}"](0) for state in moved.STATES)
    assert len(moved._only_in(before, after)) == 8  # the chair is six boxes
    assert len(moved._only_in(after, before)) == 7
