import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from vnav.config import FeaturesConfig, SiftConfig
from vnav.features.matching import match
from vnav.features.sift import ROOT_SCALE, Sift, root_sift, self_test


def test_a_disc_is_found_at_its_centre() -> None:
    # Drawn at sixteenths of a pixel; the patch's size is about that of the disc.
    image = np.zeros((96, 128, 3), np.uint8)
    centre = np.array([70.25, 40.5])
    cv2.circle(image, (centre * 16).astype(int), 9 * 16, (255,) * 3, -1, cv2.LINE_AA, 4)
    found = Sift(FeaturesConfig()).extract(image)
    off = np.linalg.norm(found.keypoints_px - centre, axis=1)
    assert off.min() < 0.1
    assert 9 < found.scales_px[off.argmin()] < 36


def test_root_sift_has_the_length_of_its_scale() -> None:
    plain = np.random.default_rng(0).integers(0, 200, (20, 128)).astype(np.float32)
    np.testing.assert_allclose(np.linalg.norm(root_sift(plain), axis=1), ROOT_SCALE, rtol=1e-5)


def test_root_sift_of_an_empty_descriptor_is_empty() -> None:
    assert not root_sift(np.zeros((1, 128), np.float32)).any()


def test_plain_sift_is_had_by_choice() -> None:
    image = np.random.default_rng(1).integers(0, 256, (80, 80, 3)).astype(np.uint8)
    image = cv2.GaussianBlur(image, (0, 0), 2)
    plain = Sift(FeaturesConfig(sift=SiftConfig(root_sift=False))).extract(image)
    root = Sift(FeaturesConfig(sift=SiftConfig(root_sift=True))).extract(image)
    np.testing.assert_array_equal(plain.keypoints_px, root.keypoints_px)
    rooted = root_sift(plain.descriptors.astype(np.float32))
    # Plain SIFT is stored in whole numbers, too: rounding both is off by 1 where numbers are small.
    assert np.abs(rooted - root.descriptors).max() <= 1


def test_the_strongest_are_kept() -> None:
    noise = cv2.GaussianBlur(np.random.default_rng(1).standard_normal((160, 220)), (0, 0), 2)
    image = np.repeat((128 + 30 * noise / noise.std()).clip(0, 255)[..., None], 3, 2)
    few, every = (
        Sift(FeaturesConfig(max_features=count)).extract(image.astype(np.uint8))
        for count in (50, 200)
    )
    np.testing.assert_allclose(few.scores, every.scores[:50], rtol=1e-6)


def test_a_shift_by_whole_pixels_shifts_features_by_them() -> None:
    noise = cv2.GaussianBlur(np.random.default_rng(1).standard_normal((160, 220)), (0, 0), 2)
    image = np.repeat((128 + 30 * noise / noise.std()).clip(0, 255)[..., None], 3, 2)
    image = image.astype(np.uint8)
    a, b = (Sift(FeaturesConfig()).extract(part) for part in (image, image[4:, 7:]))
    pairs = match(a, b, 0.8)
    off = a.keypoints_px[pairs[:, 0]] - b.keypoints_px[pairs[:, 1]] - (7, 4)
    assert np.median(np.linalg.norm(off, axis=1)) < 0.1


def test_the_self_test_passes() -> None:
    self_test()


def test_a_faint_image_is_searched_for_weak_features() -> None:
    # Blobs of 3 grey levels: below the usual threshold of 0.015 / 3 layers * 255 in contrast.
    noise = cv2.GaussianBlur(np.random.default_rng(2).standard_normal((120, 160)), (0, 0), 2)
    faint = np.repeat(np.rint(128 + 3 * noise / noise.std())[..., None], 3, 2).astype(np.uint8)
    usual = Sift(FeaturesConfig(sift=SiftConfig(few_features=0))).extract(faint)
    weak = Sift(FeaturesConfig(sift=SiftConfig(few_features=400))).extract(faint)
    assert len(weak) > 2 * len(usual)


def test_an_image_with_enough_features_is_searched_once() -> None:
    noise = cv2.GaussianBlur(np.random.default_rng(3).standard_normal((240, 320)), (0, 0), 2)
    rich = np.repeat((128 + 30 * noise / noise.std()).clip(0, 255)[..., None], 3, 2)
    usual = Sift(FeaturesConfig(sift=SiftConfig(few_features=0))).extract(rich.astype(np.uint8))
    weak = Sift(FeaturesConfig(sift=SiftConfig(few_features=400))).extract(rich.astype(np.uint8))
    assert len(weak) == len(usual) > 400


@pytest.mark.parametrize("before", [3, 30])
@pytest.mark.parametrize("now", [3, 5, 30])
def test_the_image_before_changes_no_features(before: int, now: int) -> None:
    """After a faint image the weak search is made first; an image of 5 has 517 strong features."""
    used = Sift(FeaturesConfig())
    used.extract(_blobs(before))
    found, alone = (sift.extract(_blobs(now)) for sift in (used, Sift(FeaturesConfig())))
    np.testing.assert_array_equal(found.keypoints_px, alone.keypoints_px)
    np.testing.assert_array_equal(found.descriptors, alone.descriptors)


def _blobs(contrast: float) -> NDArray[np.uint8]:
    """An image of blobs of so many grey levels."""
    noise = cv2.GaussianBlur(np.random.default_rng(4).standard_normal((240, 320)), (0, 0), 2)
    gray = (128 + contrast * noise / noise.std()).clip(0, 255).astype(np.uint8)
    return np.repeat(gray[..., None], 3, 2)
