"""What every tracker must hold; a new one in TRACKERS is tested by being there.

A camera moves by 3 cm in front of a wall at 1.5 m with a box before it: 5 px, and 10 on the box.
"""

import numpy as np
import pytest

from tests.registration.plane_views import CAMERA, Plane, speckle, view
from vnav.config import SETTINGS, Config, load
from vnav.config.registries import FILTERS, TRACKERS, registered
from vnav.core.frame import Frame
from vnav.core.mapping import FrameFeatures
from vnav.errors import ConfigError
from vnav.features.description import FrameDescriber
from vnav.tracking.trackers import tracker

STEP_M = 0.03
SCENE = [Plane(1.5, speckle(1)), Plane(0.75, speckle(2, grain_m=0.02), (-0.3, -0.3), (-0.05, 0.1))]
BORDER_PX = 16  # within it, patches are cut off
RIGHT_PX = 3.0  # 001 section 6: a match is right within this distance of the reprojection
PREDICTION_PX = np.array([4.0, -3.0])  # that the prediction is off


@pytest.fixture(params=sorted(TRACKERS))
def config(request: pytest.FixtureRequest) -> Config:
    return load(settings=[f"tracking.method={request.param}", "features.max_features=300"])


@pytest.fixture(scope="module")
def frames() -> list[Frame]:
    return [view(SCENE, k * STEP_M, seed=k, index=k) for k in range(2)]


@pytest.fixture(scope="module")
def points(frames: list[Frame]) -> FrameFeatures:
    described = FrameDescriber(load(settings=["features.max_features=300"])).describe(0, frames[0])
    kept = described.has_depth
    return FrameFeatures(0, described.features[kept], described.points_camera[kept])


def true_px(points: FrameFeatures) -> np.ndarray:
    """Where the second frame sees each point, NaN near the border of the image."""
    px = CAMERA.project(points.points_camera - np.array([STEP_M, 0, 0]))
    inside = (px > BORDER_PX).all(1) & (px < np.array(CAMERA.size) - 1 - BORDER_PX).all(1)
    return np.where(inside[:, None], px, np.nan)


def found(config: Config, points: FrameFeatures, frames: list[Frame], at: np.ndarray) -> np.ndarray:
    return tracker(frames[0].color, points.features, config).find(frames[1].color, at)


def test_the_tracker_that_the_configuration_names_is_made(
    config: Config, frames: list[Frame], points: FrameFeatures
) -> None:
    made = tracker(frames[0].color, points.features, config)
    assert type(made) is registered(TRACKERS, config.tracking.method)


def test_the_choice_of_the_setting_is_the_registry() -> None:
    with pytest.raises(ConfigError, match=r"tracking\.method"):
        load(settings=["tracking.method=nonsense"])
    assert set(SETTINGS["tracking.method"].allowed.values) == {*TRACKERS, *FILTERS}


def test_points_are_found_where_they_are_although_predicted_elsewhere(
    config: Config, frames: list[Frame], points: FrameFeatures
) -> None:
    truth = true_px(points)
    px = found(config, points, frames, truth + PREDICTION_PX)
    off = np.linalg.norm(px - truth, axis=1)
    right, seen = off < RIGHT_PX, np.isfinite(truth[:, 0])
    precise = config.registration.search_min_inlier_share  # with fewer right, tracking is unsure
    assert right.sum() >= precise * np.isfinite(off).sum()
    assert right.sum() >= 0.5 * seen.sum()  # recall: most
    # of errors of one sigma each in x and y, half are within 1.18 sigma
    assert np.median(off[right]) < 1.18 * config.registration.pixel_sigma_px


def test_points_that_are_predicted_nowhere_are_not_found(
    config: Config, frames: list[Frame], points: FrameFeatures
) -> None:
    truth = true_px(points)
    truth[::2] = np.nan
    px = found(config, points, frames, truth)
    assert px.shape == truth.shape
    assert not np.isfinite(px[::2]).any()
    assert np.isfinite(px[1::2]).any()


def test_nothing_is_found_in_an_image_of_one_colour(
    config: Config, frames: list[Frame], points: FrameFeatures
) -> None:
    blank = np.full_like(frames[1].color, 128)
    px = tracker(frames[0].color, points.features, config).find(blank, true_px(points))
    assert not np.isfinite(px).any()


def test_an_image_without_points_is_legal(
    config: Config, frames: list[Frame], points: FrameFeatures
) -> None:
    none = FrameFeatures(0, points.features[:0], points.points_camera[:0])
    assert found(config, none, frames, np.zeros((0, 2))).shape == (0, 2)


def test_the_same_images_give_the_same_places(
    config: Config, frames: list[Frame], points: FrameFeatures
) -> None:
    truth = true_px(points)
    first, second = (found(config, points, frames, truth) for _ in range(2))
    np.testing.assert_array_equal(first, second)
