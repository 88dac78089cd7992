import dataclasses
from pathlib import Path

import numpy as np
import pytest

from vnav.config import Config
from vnav.core import se3
from vnav.core.map_index import MapIndex
from vnav.core.voxels import FARTHEST, Voxels
from vnav.io.store.map_folder import MapFolder
from vnav.localisation.pixels import Pixels
from vnav.localisation.verification.pixel_cells import misfits, noise
from vnav.localisation.verification.rendering import rendered, standing_points
from vnav.localisation.view import View
from vnav.stages.locate import Locator

SHOWN = 0.5  # of the image at least: the tiny capture's depth has holes and edges


@pytest.fixture(scope="module")
def locator(whole_map: Path) -> Locator:
    return Locator.open(MapFolder(whole_map), Config())


@pytest.fixture
def number(locator) -> int:
    """A keyframe amid the others."""
    return locator.database.index.keyframes // 2


@pytest.fixture
def view(locator, number) -> View:
    """Where it was taken."""
    T_world_keyframe = locator.database.index.T_world_keyframe[number]
    return View(se3.inverse(T_world_keyframe), locator.map_cameras[0])


@pytest.fixture
def pixels(locator, number) -> Pixels:
    """Its own image as a photo."""
    frame = locator.keyframe(number)
    return Pixels(np.asarray(frame.color), frame.intrinsics, locator.keyframe)


def shown_from(view: View, index: MapIndex, pixels: Pixels, photo: np.ndarray) -> np.ndarray:
    """That photo, as the keyframes show it."""
    return rendered(view, photo, index, lambda k: standing_points(pixels.keyframe(k), k, index))


def test_a_photo_is_shown_from_where_it_was_taken(locator, view, pixels):
    shown = shown_from(view, locator.database.index, pixels, pixels.photo)
    assert np.isfinite(shown).all(2).mean() > SHOWN
    found = misfits(pixels.photo, shown, noise(pixels.photo, [shown]))
    assert np.nanmean(found) < 0.01


def test_it_is_not_shown_from_elsewhere(locator, view, pixels):
    beside = View(view.T_camera_world @ se3.make(np.eye(3), (0.3, 0.3, 0.0)), view.intrinsics)
    shown = shown_from(beside, locator.database.index, pixels, pixels.photo)
    found = misfits(pixels.photo, shown, noise(pixels.photo, [shown]))
    assert np.nanmean(found) > 0.1


def test_where_no_keyframe_has_been_nothing_is_shown(locator, view, pixels):
    far = View(view.T_camera_world @ se3.make(np.eye(3), (0.0, 0.0, 100.0)), view.intrinsics)
    assert np.isnan(shown_from(far, locator.database.index, pixels, pixels.photo)).all()


def test_keyframes_are_as_bright_as_the_photo(locator, view, pixels):
    """A photo by another exposure and white balance has other colours for the same things."""
    gain = np.array([0.6, 0.7, 0.9], np.float32)
    photos = pixels.photo, pixels.photo * gain
    shown, as_bright = (shown_from(view, locator.database.index, pixels, p) for p in photos)
    ratio = np.nanmedian(as_bright / shown, axis=(0, 1))
    np.testing.assert_allclose(ratio, gain, rtol=0.03)


def test_what_does_not_stand_in_the_map_is_not_shown(locator, view, pixels):
    """People in keyframes, and what has departed, are no occupied voxels."""
    index = locator.database.index
    away = index.solid_away.copy()
    away[: away.shape[0] // 2] = FARTHEST
    half = dataclasses.replace(index, solid_away=away)
    none = dataclasses.replace(index, solid_away=np.full_like(away, FARTHEST))
    shown = [shown_from(view, i, pixels, pixels.photo) for i in (index, half, none)]
    assert np.isfinite(shown[1]).mean() < np.isfinite(shown[0]).mean()
    assert np.isnan(shown[2]).all()


def test_what_stands_behind_something_is_not_shown(locator, view, pixels):
    """A wall half a metre before the camera, which no keyframe has depth of."""
    index = locator.database.index
    T = view.T_world_camera
    across = np.stack(np.meshgrid(np.arange(-2, 2, 0.04), np.arange(-2, 2, 0.04)), -1).reshape(
        -1, 2
    )
    wall = se3.transform(T, np.column_stack([across, np.full(len(across), 0.5)]))
    solid = np.argwhere(index.solid_away == 0) * index.solid_m + index.solid_origin
    centres = np.concatenate([solid + index.solid_m / 2, wall])
    voxels = Voxels.filled(centres, np.full(len(centres), index.solid_m[0]), index.solid_m[0])
    hidden = dataclasses.replace(index, solid_away=voxels.away, solid_origin=voxels.origin)
    shown = (shown_from(view, i, pixels, pixels.photo) for i in (index, hidden))
    shares = [np.isfinite(image).mean() for image in shown]
    assert shares[1] < 0.2 * shares[0]


def test_a_photo_in_small_has_no_distortion(locator, view, pixels):
    """A barrel distortion of 20 % at the corner bends what the keyframe shows straight."""
    camera = dataclasses.replace(view.intrinsics, distortion=(-0.2, 0.0, 0.0, 0.0, 0.0))
    frame = locator.keyframe(0)
    straight, bent = (
        Pixels(np.asarray(frame.color), c, locator.keyframe).photo
        for c in (frame.intrinsics, camera)
    )
    height, width = straight.shape[:2]
    middle = np.s_[height // 2 - 5 : height // 2 + 5, width // 2 - 5 : width // 2 + 5]
    assert np.abs(straight[middle] - bent[middle]).mean() < 5
    assert np.abs(straight - bent).mean() > 5
