"""ORB: where its corners are, and which are kept."""

import cv2
import numpy as np
import pytest

from vnav.config import FeaturesConfig, OrbConfig
from vnav.features.orb import CELL_PX, Orb


def corners(contrast: float, size: tuple[int, int] = (240, 320)) -> np.ndarray:
    """A grid of small bright squares on grey, 20 px apart."""
    image = np.full((*size, 3), 90.0)
    for y in range(30, size[0] - 30, 20):
        for x in range(30, size[1] - 30, 20):
            image[y : y + 6, x : x + 6] += contrast
    return image.clip(0, 255).astype(np.uint8)


@pytest.mark.parametrize("level", [0, 1, 2, 3])
def test_corners_of_every_level_are_mirrored_with_the_image(level: int) -> None:
    # Were a pixel's corner taken for its centre, they would be off by scale - 1 in the mirror.
    noise = np.random.default_rng(0).uniform(0, 255, (240, 320))
    noise = cv2.GaussianBlur(noise, (0, 0), 3)
    image = np.repeat(((noise - noise.min()) * 255 / np.ptp(noise))[..., None], 3, 2)
    places = []
    for view in (image, image[:, ::-1]):
        found = Orb(FeaturesConfig()).extract(np.ascontiguousarray(view, np.uint8))
        of_level = np.isclose(found.scales_px, 31 * 1.2**level, rtol=1e-3)
        places.append(found.keypoints_px[of_level])
    mirrored = [319, 0] + places[1] * [-1, 1]
    off = np.linalg.norm(places[0][:, None] - mirrored[None], axis=2).min(1)
    assert len(off) > 50
    assert np.median(off) < 0.1 * 1.2**level


def test_a_part_of_the_image_without_strong_corners_keeps_its_weak_ones() -> None:
    image = corners(100)
    image[:, 160:] = corners(12)[:, 160:]
    found = Orb(FeaturesConfig(max_features=2000)).extract(image)
    in_weak_half = found.keypoints_px[:, 0] > 160 + CELL_PX
    assert in_weak_half.sum() > 20
    strong_only = FeaturesConfig(max_features=2000, orb=OrbConfig(weak_threshold=20))
    assert not (Orb(strong_only).extract(image).keypoints_px[:, 0] > 160 + CELL_PX).any()


@pytest.mark.parametrize("most", [1, 2, 3, 7, 50, 333, 1500])
def test_no_more_are_kept_than_asked_for(most: int) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (240, 320, 3), np.uint8)
    assert len(Orb(FeaturesConfig(max_features=most)).extract(noise)) <= most


def test_weak_corners_beside_strong_ones_are_not_taken() -> None:
    found = Orb(FeaturesConfig(max_features=2000)).extract(corners(100))
    assert (found.scores >= 20).all()


def test_a_corner_keeps_its_orientation_relative_to_the_image() -> None:
    rng = np.random.default_rng(0)
    noise = cv2.GaussianBlur(rng.uniform(0, 255, (200, 200)), (0, 0), 2)
    image = np.repeat(((noise - noise.min()) * 255 / np.ptp(noise))[..., None], 3, 2)
    image = image.astype(np.uint8)
    upright = Orb(FeaturesConfig(orb=OrbConfig(levels=1))).extract(image)
    turned = Orb(FeaturesConfig(orb=OrbConfig(levels=1))).extract(np.rot90(image).copy())
    # A quarter turn against the clock takes (x, y) to (y, 199 - x), and turns angles by -90.
    places = {
        tuple(p): a for p, a in zip(turned.keypoints_px.tolist(), turned.angles_rad, strict=True)
    }
    both = [
        (angle, places[(y, 199 - x)])
        for (x, y), angle in zip(upright.keypoints_px.tolist(), upright.angles_rad, strict=True)
        if (y, 199 - x) in places
    ]
    assert len(both) > 0.8 * len(upright)
    turns = np.array([(b - a + np.pi / 2) for a, b in both])
    assert np.abs(np.angle(np.exp(1j * turns))).max() < np.deg2rad(1)


def test_a_relative_threshold_is_a_share_of_the_corners_own_brightness() -> None:
    # Dark squares, 12 darker than their ground, on grey of 40 and of 200: 12 is more than a fifth
    # of the corner's brightness of 28 and less than a fifth of 188.
    image = np.full((240, 320, 3), 40, np.uint8)
    image[:, 160:] = 200
    for y in range(30, 210, 20):
        for x in (*range(30, 130, 20), *range(190, 290, 20)):
            image[y : y + 6, x : x + 6] -= 12
    relative = OrbConfig(relative_threshold=0.2)
    found = Orb(FeaturesConfig(orb=relative)).extract(image).keypoints_px[:, 0]
    assert (found < 150).sum() > 20
    assert not (found > 170).any()
    absolute = Orb(FeaturesConfig()).extract(image).keypoints_px[:, 0]
    assert (absolute > 170).sum() > 20


def test_a_relative_threshold_finds_more_of_what_exposure_scales_down() -> None:
    rng = np.random.default_rng(0)
    noise = cv2.GaussianBlur(rng.uniform(0, 1, (240, 320)), (0, 0), 2)
    bright = 60 + 180 * (noise - noise.min()) / np.ptp(noise)
    again = []
    for relative in (0.2, 0.0):
        config = OrbConfig(relative_threshold=relative, weak_threshold=20, levels=1)
        orb, places = Orb(FeaturesConfig(orb=config)), []
        for view in (bright, bright / 4):
            image = np.repeat(np.rint(view)[..., None], 3, 2).astype(np.uint8)
            places.append({tuple(p) for p in orb.extract(image).keypoints_px.tolist()})
        assert len(places[0]) > 100
        again.append(len(places[0] & places[1]) / len(places[0]))
    assert again[0] > 2 * again[1]
