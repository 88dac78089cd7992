"""Points seen by a camera that was given the wrong focal length."""

from dataclasses import replace

import numpy as np
import pytest

from vnav.config import RegistrationConfig
from vnav.core import se3
from vnav.core.camera import Intrinsics
from vnav.core.frame import Features
from vnav.core.mapping import FrameFeatures
from vnav.features.sift import SPACE
from vnav.optimisation.bundle import adjust
from vnav.optimisation.feature_tracks import FeatureTracks
from vnav.optimisation.focal_length import PRIOR_SHARE, FocalLength, focal_lengths
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


def fitted(given: list[Intrinsics], seed: int = 0, seen_by: int = KEYFRAMES) -> list[FocalLength]:
    """Of keyframes that turn and move, the first of which see anything, as the given cameras do.

    Poses and points are those that explain it best by the given cameras.
    """
    rng = np.random.default_rng(seed)
    T = se3.exp(rng.uniform(-1, 1, (KEYFRAMES, 6)) * np.repeat([0.25, 0.5], 3))
    points = rng.uniform([-3, -2, 2], [3, 2, 5], (POINTS, 3))
    keyframes = []
    for k in range(KEYFRAMES):
        inside = se3.transform(se3.inverse(T[k]), points)
        px = TRUE.project(inside) + PIXEL_SIGMA * rng.standard_normal((POINTS, 2))
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
    return list(focal_lengths(bundle, tracks, selection))


@pytest.mark.parametrize("share", [-0.15, -0.03, 0.0, 0.03, 0.15])
def test_the_focal_length_is_found_whatever_was_given(share: float) -> None:
    (found,) = fitted([longer(share)] * KEYFRAMES)
    assert found.given_px == pytest.approx(TRUE.fx * (1 + share))
    assert found.sigma_px < 0.01 * TRUE.fx
    assert abs(found.fitted_px - TRUE.fx) < 4 * found.sigma_px


def test_its_standard_deviation_is_that_of_its_errors() -> None:
    found = [fitted([TRUE] * KEYFRAMES, seed)[0] for seed in range(12)]
    errors = np.array([(f.fitted_px - TRUE.fx) / f.sigma_px for f in found])
    # The root mean square of twelve is within 0.5 and 1.6 by chance 99 times of 100.
    assert 0.5 < np.sqrt(np.mean(errors**2)) < 1.6


def test_each_camera_is_asked_for_itself() -> None:
    wrong, right = fitted([longer(0.1), TRUE] * (KEYFRAMES // 2))
    assert wrong.given_px > 1.05 * TRUE.fx
    assert abs(wrong.fitted_px - TRUE.fx) < 4 * wrong.sigma_px
    assert abs(right.fitted_px - TRUE.fx) < 4 * right.sigma_px


def test_views_that_share_too_little_tell_nothing() -> None:
    (found,) = fitted([longer(0.1)] * KEYFRAMES, seen_by=1)
    assert found.fitted_px == found.given_px
    assert found.sigma_px == pytest.approx(PRIOR_SHARE * found.given_px)
