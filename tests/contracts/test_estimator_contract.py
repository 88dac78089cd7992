"""What every estimator must hold; a new one in ESTIMATORS is tested by being there.

Views are rendered, with the noise of a Kinect; matches are made of the true motion, with noise.
"""

import numpy as np
import pytest

from tests.registration.plane_views import CAMERA, Plane, speckle, view
from vnav.config import SETTINGS, RegistrationConfig, load
from vnav.config.registries import ESTIMATORS, registered
from vnav.core import se3
from vnav.core.frame import Features, Frame, PoseEstimate, Rejected
from vnav.core.mapping import FrameFeatures
from vnav.errors import ConfigError
from vnav.features.sift import SPACE
from vnav.registration.correspondences import Correspondences
from vnav.registration.estimators import estimator
from vnav.registration.reduction import reduced

SCENE = [
    Plane(2.0, speckle(1)),
    Plane(1.3, speckle(2), (-0.6, -0.5), (-0.1, 0.2)),
    Plane(1.6, speckle(3), (0.2, -0.2), (0.7, 0.5)),
]
STEP = (0.06, -0.03)  # m, right and up
CHI_SQUARED = 22.5  # 6 degrees of freedom: 99.9 % of right motions are below
COUNT, SEEDS = 120, 5
Seen = tuple[Frame, np.ndarray]  # and the camera's place


@pytest.fixture(params=sorted(ESTIMATORS))
def config(request: pytest.FixtureRequest) -> RegistrationConfig:
    return load(settings=[f"registration.estimator={request.param}"]).registration


@pytest.fixture(scope="module")
def frames() -> list[Seen]:
    """The first frame is seen from the origin, the second from there, and the third a step on."""
    places = [(0.0, 0.0), (0.0, 0.0), STEP]
    return [
        (view(SCENE, x, y, seed=k, index=k), np.array([x, y, 0.0]))
        for k, (x, y) in enumerate(places)
    ]


def measured(
    points: np.ndarray, at: np.ndarray, row: int, config: RegistrationConfig, seed: int
) -> FrameFeatures:
    """Points (N, 3) in space as a camera at a place measures them."""
    rng, n = np.random.default_rng([seed, row]), len(points)
    px = CAMERA.project(points - at) + config.pixel_sigma_px * rng.standard_normal((n, 2))
    inverse = 1 / points[:, 2] + config.depth_sigma_per_m2 * rng.standard_normal(n)
    none = np.zeros(n)
    features = Features(px, np.zeros((n, SPACE.width), np.uint8), none, none, none, SPACE)
    return FrameFeatures(row, features, CAMERA.unproject(px, 1 / inverse))


def matched(
    a: Seen,
    b: Seen,
    config: RegistrationConfig,
    count: int = COUNT,
    wrong: float = 0.0,
    seed: int = 0,
) -> Correspondences:
    """So many matches, spread over both images, of which a share is wrong."""
    rng = np.random.default_rng(seed)
    px = rng.uniform(20, np.array(CAMERA.size) - 20, (count, 2))
    depth_m = np.asarray(a[0].depth_m)[tuple(px.round().astype(int)[:, ::-1].T)]
    points = CAMERA.unproject(px, depth_m.astype(float)) + a[1]
    rows = np.arange(count, dtype=np.int32)
    of_b = rows.copy()
    few = rng.permutation(count)[: int(wrong * count)]
    of_b[few] = np.roll(few, 1)
    return Correspondences(
        measured(points, a[1], 0, config, seed),
        measured(points, b[1], 1, config, seed),
        np.stack([rows, of_b], 1),
        (CAMERA, CAMERA),
        config,
        (reduced(a[0]), reduced(b[0])),
    )


def found(pairs: Correspondences, config: RegistrationConfig) -> PoseEstimate | Rejected:
    return estimator(config).estimate(pairs, np.random.default_rng(0))


def squared_error(estimate: PoseEstimate | Rejected, a: Seen, b: Seen) -> float:
    """Of a motion between two places, by its own information."""
    assert isinstance(estimate, PoseEstimate)
    off = se3.deviation(se3.inverse(se3.make(np.eye(3), b[1] - a[1])) @ estimate.T_a_b)
    return float(off @ estimate.information @ off)


def test_the_estimator_that_the_configuration_names_is_made(config: RegistrationConfig) -> None:
    assert type(estimator(config)) is registered(ESTIMATORS, config.estimator)


def test_the_choice_of_the_setting_is_the_registry() -> None:
    with pytest.raises(ConfigError, match=r"registration\.estimator"):
        load(settings=["registration.estimator=nonsense"])
    assert set(SETTINGS["registration.estimator"].allowed.values) == set(ESTIMATORS)


@pytest.mark.parametrize("second", [1, 2])
def test_rest_and_a_known_motion_are_found_as_exactly_as_the_information_says(
    config: RegistrationConfig, frames: list[Seen], second: int
) -> None:
    a, b = frames[0], frames[second]
    for seed in range(SEEDS):
        estimate = found(matched(a, b, config, seed=seed), config)
        assert squared_error(estimate, a, b) < CHI_SQUARED
        sigma_m = np.sqrt(np.linalg.inv(estimate.information).diagonal()[3:].max())
        assert sigma_m < 0.01  # 120 matches of 1 px at 2 m: 2 m / 262 px / sqrt(120 / 6) = 2 mm


def test_half_of_the_matches_may_be_wrong(config: RegistrationConfig, frames: list[Seen]) -> None:
    a, b = frames[0], frames[2]
    for seed in range(SEEDS):
        pairs = matched(a, b, config, wrong=0.5, seed=seed)
        estimate = found(pairs, config)
        assert squared_error(estimate, a, b) < CHI_SQUARED
        right = estimate.inliers[:, 0] == estimate.inliers[:, 1]
        assert right.mean() > 0.95
        assert right.sum() > 0.8 * COUNT / 2  # of those there are


def test_too_few_matches_are_refused(config: RegistrationConfig, frames: list[Seen]) -> None:
    for count in (0, 2, config.min_inliers - 1):
        pairs = matched(frames[0], frames[2], config, count)
        assert isinstance(found(pairs, config), Rejected)


def test_matches_that_are_all_wrong_are_refused(
    config: RegistrationConfig, frames: list[Seen]
) -> None:
    pairs = matched(frames[0], frames[2], config, wrong=1.0)
    assert isinstance(found(pairs, config), Rejected)


def test_a_first_motion_nearby_is_refined(config: RegistrationConfig, frames: list[Seen]) -> None:
    a, b = frames[0], frames[2]
    first = se3.make(np.eye(3), b[1]) @ se3.exp([0.01, -0.01, 0.01, 0.01, 0.01, -0.01])
    refined = estimator(config).refine(first, matched(a, b, config))
    assert squared_error(refined, a, b) < CHI_SQUARED


def test_the_same_matches_give_the_same_motion(
    config: RegistrationConfig, frames: list[Seen]
) -> None:
    pairs = matched(frames[0], frames[2], config, wrong=0.3)
    first, second = (found(pairs, config) for _ in range(2))
    np.testing.assert_array_equal(first.T_a_b, second.T_a_b)
