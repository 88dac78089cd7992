"""How far a whole image has turned: where the search for features begins.

The sources predict at constant velocity alone. A hand turns a camera by 50 px from one frame to the
next where half of that was predicted, and rolls it by 4 degrees: templates are then neither near
nor upright. Sources: Klein, Murray, "Improving the agility of keyframe-based SLAM", 2008, section
3.3; Kuglin, Hines, "The phase correlation image alignment method", 1975; Evangelidis, Psarakis,
"Parametric image alignment using enhanced correlation coefficient maximization", 2008.
"""

from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array, Floats
from vnav.core.camera import Intrinsics
from vnav.tracking.ekf.state import SPIN, VELOCITY, FilterState
from vnav.tracking.ekf.update import joseph

MIN_RESPONSE = 0.25  # of the phase correlation's peak
MIN_CORRELATION = 0.9  # of the aligned images
SHIFT_SIGMA_PX = 10.0  # in pixels of the whole image: near things shift more than far ones
ROLL_SIGMA_RAD = np.deg2rad(1.0)
BLUR_PX = 1.0  # of the images that are aligned, half as wide as those that are shifted
NO_MASK: Any = None
STOP = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-6)


def turned(
    state: FilterState, before: Floats, after: Floats, step_s: float, camera: Intrinsics
) -> FilterState:
    """A predicted state, corrected by how one small image (h, w) lies on the next.

    That measures the camera's angular velocity, once what it passes is taken off; where it is not
    clear, nothing does.
    """
    turn = image_turn(before, after)
    per_px = camera.width / after.shape[1]
    focal = np.array([camera.fy, camera.fx])
    angles = np.array([turn[1] * per_px / camera.fy, -turn[0] * per_px / camera.fx, -turn[2]])
    sigma = np.append(SHIFT_SIGMA_PX / focal, ROLL_SIGMA_RAD)
    known = np.flatnonzero(np.isfinite(angles))
    if not len(known):
        return state
    passing, passing_sigma = _passing(state)
    measured = SPIN.start + known
    HP = state.P[measured]
    S = HP[:, measured] + np.diag((sigma[known] / step_s) ** 2 + passing_sigma[known] ** 2)
    spin = angles[known] / step_s - passing[known]
    return joseph(state, HP, S, spin - state.x[measured])


def _passing(state: FilterState) -> tuple[Array, Array]:
    """How fast what is seen turns past a camera that moves, rad/s (3,), and the deviation of that.

    It is as far as the median feature was when first seen; without features it is far.
    """
    right, down, _ = state.T_world_camera[:3, :3].T  # the camera's axes in the world
    near = max(0.0, float(np.median(state.features[:, 5]))) if len(state.features) else 0.0
    by_velocity = near * np.stack([-down, right, np.zeros(3)])
    covariance = by_velocity @ state.P[VELOCITY, VELOCITY] @ by_velocity.T
    return by_velocity @ state.x[VELOCITY], np.sqrt(np.diag(covariance))


def image_turn(before: Floats, after: Floats) -> Array:
    """Shift of the middle along x and y, in pixels, and angle from x to y, of an image's content.

    By the alignment of two images (h, w) by enhanced correlation, which begins at the shift by
    phase correlation. NaN where it is not clear: the angle, or all three.
    """
    window = _window(after.shape)  # OpenCV would multiply the images themselves by it
    shift, response = cv2.phaseCorrelate(before * window, after * window)
    small = [
        cv2.GaussianBlur(cv2.resize(image, None, fx=0.5, fy=0.5), (0, 0), BLUR_PX)
        for image in (before, after)
    ]
    begin = np.array([[1, 0, shift[0] / 2], [0, 1, shift[1] / 2]], np.float32)
    try:
        correlation, A = cv2.findTransformECC(
            small[0], small[1], begin, cv2.MOTION_EUCLIDEAN, STOP, NO_MASK, 1
        )
    except cv2.error:  # it does not converge
        correlation = 0.0
    if correlation >= MIN_CORRELATION:
        middle = (np.array(small[0].shape[::-1]) - 1) / 2
        moved = A[:, :2] @ middle + A[:, 2] - middle
        return np.array([*(2 * moved), np.arctan2(A[1, 0], A[0, 0])])
    return np.array([*(shift if response >= MIN_RESPONSE else (np.nan, np.nan)), np.nan])


@lru_cache(maxsize=1)
def _window(shape: tuple[int, int]) -> NDArray[np.float32]:
    """That takes the borders' weight, which wrap around in a Fourier transform."""
    return np.asarray(cv2.createHanningWindow(shape[::-1], cv2.CV_32F), np.float32)
