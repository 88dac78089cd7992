"""Points seen by a camera that was given the wrong focal length, principal point or lens."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.frame import Features
from vnav.core.mapping import FrameFeatures
from vnav.features.sift import SPACE
from vnav.optimisation.bundle import adjust
from vnav.optimisation.camera_fit import PRIORS, CameraFit, camera_fits
from vnav.optimisation.feature_tracks import FeatureTracks
from vnav.optimisation.observation_selection import ObservationSelection
from vnav.optimisation.sensor_model import Bundle, SensorModel

TRUE = Intrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
CONFIG = RegistrationConfig()
KEYFRAMES, POINTS = 8, 300
PIXEL_SIGMA = 0.3
ITERATIONS = 20


def longer(share: float) -> Intrinsics:
    """The true camera with a focal length that is larger by a share."""
    return replace(TRUE, fx=TRUE.fx * (1 + share), fy=TRUE.fy * (1 + share))


def fitted(
    given: list[Intrinsics], seed: int = 0, seen_by: int = KEYFRAMES, lens: Intrinsics = TRUE
) -> list[CameraFit]:
    """Of keyframes that turn and move, the first of which see anything, as the given cameras do.

    Poses and points are those that explain it best by the given cameras.
    """
    rng = np.random.default_rng(seed)
    T = se3.exp(rng.uniform(-1, 1, (KEYFRAMES, 6)) * np.repeat([0.25, 0.5], 3))
    points = rng.uniform([-3, -2, 2], [3, 2, 5], (POINTS, 3))
    keyframes = []
    for k in range(KEYFRAMES):
        inside = se3.transform(se3.inverse(T[k]), points)
        px = _seen_through(lens, inside) + PIXEL_SIGMA * rng.standard_normal((POINTS, 2))
        noise = CONFIG.depth_sigma_per_m2 * rng.standard_normal(POINTS)
        depth_m = 1 / (1 / inside[:, 2] + noise)
        seen = ((px > 0) & (px < TRUE.size)).all(1) & (k < seen_by)
        lifted = np.where(seen[:, None], given[k].unproject(px, depth_m), np.nan)
        n = np.ones(POINTS)
        features = Features(
            px.astype(np.float32), np.zeros((POINTS, 128), np.uint8), n, n, 0 * n, SPACE
        )
        keyframes.append(FrameFeatures(k, features, lifted.astype(np.float32)))
    tracks = FeatureTracks(keyframes, [np.arange(POINTS, dtype=np.int32)] * KEYFRAMES)
    rows = np.flatnonzero(np.isfinite(tracks.seen.inverse_depth))
    bundle = Bundle(T, tracks.points_world(T, rows))
    selection = ObservationSelection(rows, SensorModel(given, CONFIG), [], None, 0)
    bundle = adjust(bundle, selection.problem(tracks.seen[rows], selection.model), ITERATIONS)
    return list(camera_fits(bundle, tracks, selection))


def _seen_through(lens: Intrinsics, points_camera: np.ndarray) -> np.ndarray:
    px, _ = cv2.projectPoints(
        points_camera, np.zeros(3), np.zeros(3), lens.K, np.array(lens.distortion or (0.0,) * 4)
    )
    return px[:, 0]


def in_sigmas(found: CameraFit) -> np.ndarray:
    """How far focal length, principal point and distortion are from the true ones."""
    true = np.array([TRUE.fx, TRUE.cx, TRUE.cy, 0.0])
    return np.abs(np.array(found.fitted) - true) / np.array(found.sigma)


@pytest.mark.parametrize("share", [-0.15, -0.03, 0.0, 0.03, 0.15])
def test_the_focal_length_is_found_whatever_was_given(share: float) -> None:
    (found,) = fitted([longer(share)] * KEYFRAMES)
    assert found.given[0] == pytest.approx(TRUE.fx * (1 + share))
    assert max(found.sigma) < 0.01 * TRUE.fx
    assert (in_sigmas(found) < 4).all()
    assert found.off[0] == pytest.approx(abs(TRUE.fx / found.given[0] - 1), abs=0.01)


@pytest.mark.parametrize(("x_px", "y_px"), [(20.0, 0.0), (0.0, -20.0), (-40.0, 30.0)])
def test_so_is_the_principal_point(x_px: float, y_px: float) -> None:
    camera = replace(longer(0.05), cx=TRUE.cx + x_px, cy=TRUE.cy + y_px)
    (found,) = fitted([camera] * KEYFRAMES)
    assert tuple(found.given[1:3]) == (camera.cx, camera.cy)
    assert (in_sigmas(found) < 4).all()


@pytest.mark.parametrize("k1", [-0.1, 0.1])
def test_so_is_a_distortion_that_was_left_out(k1: float) -> None:
    lens = replace(TRUE, distortion=(k1, 0.0, 0.0, 0.0))
    (found,) = fitted([TRUE] * KEYFRAMES, lens=lens)
    # Undistorting by one term leaves out the next, 3 k1^2 r^5, which is largest in a corner.
    assert found.fitted[3] == pytest.approx(k1, rel=3 * abs(k1) * found.corner**2)
    assert abs(found.fitted[3]) > 50 * found.sigma[3]
    assert found.off[3] == pytest.approx(abs(found.fitted[3]) * (400 / 525) ** 3)


def test_their_standard_deviations_are_those_of_their_errors() -> None:
    errors = np.array([in_sigmas(fitted([TRUE] * KEYFRAMES, seed)[0]) for seed in range(12)])
    # The root mean square of twelve is within 0.5 and 1.6 by chance 99 times of 100.
    rms = np.sqrt(np.mean(errors**2, axis=0))
    assert (rms > 0.5).all()
    assert (rms < 1.6).all()


def test_each_camera_is_asked_for_itself() -> None:
    wrong, right = fitted([longer(0.1), TRUE] * (KEYFRAMES // 2))
    assert wrong.given[0] > 1.05 * TRUE.fx
    assert (in_sigmas(wrong) < 4).all()
    assert (in_sigmas(right) < 4).all()


def test_views_that_share_too_little_tell_nothing() -> None:
    (found,) = fitted([longer(0.1)] * KEYFRAMES, seen_by=1)
    assert found.fitted == found.given
    unit = np.array([*[found.given[0]] * 3, 1.0])
    assert found.sigma == pytest.approx(PRIORS * unit)
