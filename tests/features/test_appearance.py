import numpy as np

from vnav.core.frame import Features
from vnav.features.appearance import global_descriptor
from vnav.features.sift import SPACE


def features(descriptors: np.ndarray) -> Features:
    n = len(descriptors)
    return Features(np.zeros((n, 2)), descriptors, np.ones(n), np.ones(n), np.zeros(n), SPACE)


def scene(seed: int, count: int = 400) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (count, 128)).astype(np.uint8)


def test_a_frame_is_more_like_one_that_shares_half_of_it_than_like_another() -> None:
    here, there = scene(0), scene(1)
    half = np.concatenate([here[:200], scene(2)[:200]])
    target = global_descriptor(features(here))
    assert (
        target @ global_descriptor(features(half))
        > target @ global_descriptor(features(there)) + 0.2
    )


def test_a_frame_is_wholly_like_itself_in_any_order() -> None:
    here = scene(0)
    alike = global_descriptor(features(here)) @ global_descriptor(features(here[::-1]))
    assert abs(float(alike) - 1) < 1e-5  # float32


def test_no_features_look_like_nothing() -> None:
    nothing = global_descriptor(features(np.zeros((0, 128), np.uint8)))
    assert not nothing.any()
    assert nothing.shape == global_descriptor(features(scene(0))).shape
