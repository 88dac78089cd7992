"""What every front-end must hold; a new one in FRONT_ENDS is tested by being there."""

from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest

from vnav.config import SETTINGS, FeaturesConfig
from vnav.config.registries import FRONT_ENDS
from vnav.core.frame import Features
from vnav.errors import ConfigError
from vnav.features import FrontEnd, front_end
from vnav.features.matching import match

HEIGHT, WIDTH = 160, 220


@pytest.fixture(params=sorted(FRONT_ENDS))
def config(request: pytest.FixtureRequest) -> FeaturesConfig:
    return FeaturesConfig(front_end=request.param, max_features=300)


@pytest.fixture
def detector(config: FeaturesConfig) -> FrontEnd:
    return front_end(config)


def textured(seed: int = 0) -> np.ndarray:
    """Blobs of several sizes, read-only as the colour of a frame."""
    rng = np.random.default_rng(seed)
    noise = rng.uniform(0, 255, (3, HEIGHT, WIDTH, 3))
    layers = [cv2.GaussianBlur(layer, (0, 0), s) for layer, s in zip(noise, (1, 2, 4), strict=True)]
    contrast = sum((layer - layer.mean()) / layer.std() for layer in layers)
    image = np.clip(128 + 25 * contrast, 0, 255).astype(np.uint8)
    image.flags.writeable = False
    return image


def columns(features: Features) -> list[bytes]:
    return [v.tobytes() for v in vars(features).values() if isinstance(v, np.ndarray)]


def test_a_textured_image_has_features_inside_it(detector: FrontEnd) -> None:
    found = detector.extract(textured())
    assert len(found) > 100
    assert (found.keypoints_px >= -0.5).all()
    assert (found.keypoints_px <= [WIDTH - 0.5, HEIGHT - 0.5]).all()
    assert (found.scales_px > 0).all()


def test_a_blank_image_has_none(detector: FrontEnd) -> None:
    found = detector.extract(np.full((HEIGHT, WIDTH, 3), 90, np.uint8))
    assert len(found) == 0
    assert found.descriptors.shape[1] == detector.extract(textured()).descriptors.shape[1]


@pytest.mark.parametrize("size", [(1, 1), (3, 50), (16, 16)])
def test_a_tiny_image_is_legal(detector: FrontEnd, size: tuple[int, int]) -> None:
    detector.extract(textured()[: size[0], : size[1]])


def test_no_more_features_than_wanted_and_the_strongest_first(detector: FrontEnd) -> None:
    found = detector.extract(np.concatenate([textured(1), textured(2)]))
    assert 250 < len(found) <= 300
    assert (np.diff(found.scores) <= 0).all()


def test_the_same_image_gives_the_same_bytes_in_any_thread(detector: FrontEnd) -> None:
    expected = columns(detector.extract(textured()))
    with ThreadPoolExecutor(4) as pool:
        results = pool.map(detector.extract, [textured()] * 8)
        assert all(columns(found) == expected for found in results)


def test_features_move_with_the_image(detector: FrontEnd) -> None:
    shift = np.array([7, 4])
    image = textured()
    a, b = detector.extract(image), detector.extract(image[4:, 7:])
    pairs = match(a, b, 0.8)
    off = a.keypoints_px[pairs[:, 0]] - b.keypoints_px[pairs[:, 1]] - shift
    # A shift by whole pixels leaves every patch as it was, but for those the border cuts. A
    # front-end whose places are pixels of a pyramid's levels is off by a part of one.
    assert len(pairs) > 0.4 * len(a)
    assert np.median(np.linalg.norm(off, axis=1)) < 0.5


def test_features_are_known_again_in_a_turned_and_darker_image(detector: FrontEnd) -> None:
    image = textured()
    angle = 30 if detector.space.has_angles else 3
    turn = cv2.getRotationMatrix2D(
        (WIDTH / 2, HEIGHT / 2), angle, 0.9 if detector.space.has_scales else 1.0
    )
    turned = cv2.warpAffine(image, turn, (WIDTH, HEIGHT), flags=cv2.INTER_AREA) * 0.8
    a, b = detector.extract(image), detector.extract(turned.astype(np.uint8))
    pairs = match(a, b, 0.8)
    expected = a.keypoints_px[pairs[:, 0]] @ turn[:, :2].T + turn[:, 2]
    off = np.linalg.norm(expected - b.keypoints_px[pairs[:, 1]], axis=1)
    assert len(pairs) > 30
    # A corner of unknown scale may lie anywhere on its circle, of 3 px.
    assert (off < (1.5 if detector.space.has_scales else 3.0)).mean() > 0.8


def test_descriptors_are_those_of_the_space_that_has_the_front_ends_name(
    detector: FrontEnd, config: FeaturesConfig
) -> None:
    found = detector.extract(textured())
    assert found.space == detector.space
    assert found.space.front_end == config.front_end


def test_descriptors_of_unlike_things_are_as_far_apart_as_the_space_says(
    detector: FrontEnd,
) -> None:
    vectors = [detector.space.vectors(detector.extract(textured(k)).descriptors) for k in (1, 2)]
    squared = ((vectors[0][:100, None] - vectors[1][None, :100]) ** 2).sum(2)
    typical = float(np.median(detector.space.distance(squared)))
    assert 0.7 < typical / detector.space.typical < 1.4


def test_an_unknown_front_end_is_a_config_error() -> None:
    with pytest.raises(ConfigError, match=r"expected features\.front_end to be .*sift.*'swift'$"):
        FeaturesConfig(front_end="swift")


def test_surf_is_refused_with_the_reason() -> None:
    with pytest.raises(ConfigError, match=r"found 'surf'.*: SURF is patented code, which OpenCV"):
        FeaturesConfig(front_end="surf")


def test_the_configuration_knows_every_front_end() -> None:
    assert SETTINGS["features.front_end"].allowed.values == tuple(FRONT_ENDS)
