"""How a whole image moved tells how the camera turned, once what it passes is taken off."""

import cv2
import numpy as np
import pytest

from vnav.core.camera import Intrinsics
from vnav.tracking.ekf.image_turn import SHIFT_SIGMA_PX, turned
from vnav.tracking.ekf.new_features import with_features
from vnav.tracking.ekf.state import SPIN, VELOCITY, FilterState, at_rest

CAMERA = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
SMALL = 160, 120
STEP_S, NEAR = 0.1, 1 / 1.3  # of a wall at 1.3 m
PASSING_M_S = 0.9
SPIN_SIGMA_RAD_S = 1.0
MEASURED_RAD_S = SHIFT_SIGMA_PX / CAMERA.fx / STEP_S  # to which a shift tells the spin


def moving(velocity_m_s: tuple[float, float, float], sigma_m_s: float) -> FilterState:
    """A camera before a wall, which knows how fast it goes but not how it turns."""
    begun = at_rest(sigma_m_s, SPIN_SIGMA_RAD_S)
    x = begun.x.copy()
    x[VELOCITY] = velocity_m_s
    px = np.stack(np.meshgrid(np.linspace(60, 580, 6), np.linspace(60, 420, 5)), -1).reshape(-1, 2)
    n = len(px)
    return with_features(
        FilterState(x, begun.P), px, np.full(n, NEAR), np.full(n, 0.01), CAMERA, 1.0
    )


def shifted(px: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Two small images, the second's content moved by so many pixels of a whole one."""
    rng = np.random.default_rng(0)
    width, height = SMALL
    wide = cv2.GaussianBlur(
        rng.uniform(0, 255, (height + 80, width + 80)).astype(np.float32), (0, 0), 3
    )
    dx, dy = (p * width / CAMERA.width for p in px)
    A = np.array([[1, 0, dx - 40], [0, 1, dy - 40]])
    after = cv2.warpAffine(wide, A, SMALL)
    return wide[40 : 40 + height, 40 : 40 + width].copy(), after


@pytest.mark.parametrize("axis", [0, 1])
def test_what_a_camera_passes_is_no_turn(axis: int) -> None:
    velocity = PASSING_M_S * np.eye(3)[axis]
    px = -CAMERA.fx * NEAR * STEP_S * velocity[:2]
    state = turned(moving(tuple(velocity), 0.05), *shifted(tuple(px)), STEP_S, CAMERA)
    assert np.abs(state.x[SPIN]).max() < MEASURED_RAD_S / 2
    assert PASSING_M_S * NEAR > 3 * MEASURED_RAD_S  # which it would be taken for


def test_a_turn_is_found() -> None:
    spin = 0.6
    state = turned(
        moving((0, 0, 0), 0.05), *shifted((-CAMERA.fx * spin * STEP_S, 0)), STEP_S, CAMERA
    )
    np.testing.assert_allclose(state.x[SPIN], [0, spin, 0], atol=MEASURED_RAD_S)


def test_a_camera_that_does_not_know_how_fast_it_goes_hardly_takes_a_shift_for_a_turn() -> None:
    px = -CAMERA.fx * NEAR * STEP_S * PASSING_M_S, 0.0
    sure = turned(moving((0, 0, 0), 0.05), *shifted(px), STEP_S, CAMERA)
    unsure = turned(moving((0, 0, 0), 3.0), *shifted(px), STEP_S, CAMERA)
    assert abs(unsure.x[SPIN][1]) < abs(sure.x[SPIN][1]) / 2
