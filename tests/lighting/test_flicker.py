"""Captures under lamps that flicker: bands are found, and taken off."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from tests.lighting.lamp import SWING, Flickering, LampLit, banded, bands, lamp
from vnav.core.frame import Frame
from vnav.core.mapping import EVEN_LIGHT
from vnav.io.sources.capture import Capture
from vnav.io.sources.derived import DerivedCapture
from vnav.lighting.flattened import flattened
from vnav.lighting.flicker import bands_of, without_bands
from vnav.lighting.followed_points import Changes


class Resting(DerivedCapture):
    """The same by a camera that stands still."""

    def read(self, index: int) -> Frame:
        return banded(super().read(10), 3.3, index)


def even(capture: Capture) -> tuple[Capture, np.ndarray]:
    with ThreadPoolExecutor(2) as pool:
        return flattened(capture, pool)


@pytest.mark.parametrize("waves", [2.1, 3.3, 5.6])
def test_bands_are_counted(capture: Capture, waves: float) -> None:
    """To half a step of what is looked for, and a tenth for the scene's own changes."""
    _, ((corners, _, found),) = even(Flickering(capture, waves))
    assert found == pytest.approx(waves, abs=0.15)
    assert corners == 1


def test_a_camera_that_rests_sees_them_best(capture: Capture) -> None:
    assert even(Resting(capture))[1][0, 2] == pytest.approx(3.3, abs=0.05)


def test_frames_are_as_bright_in_their_rows_as_without_bands(capture: Capture) -> None:
    """But for what the scene itself has of such a wave, which is the same in frames beside."""
    steady, _ = even(Flickering(capture))
    changes = []
    for source in (capture, Flickering(capture), steady):
        a, b = (source.read(k).color.astype(float) for k in (10, 11))
        ratio = np.log(np.median(b, axis=(1, 2)) / np.median(a, axis=(1, 2)))
        changes.append(float(np.std(ratio)))
    own, banded, left = changes
    assert banded > 3 * own
    assert left < 1.5 * own


def test_even_light_and_weak_bands_leave_a_capture_as_it_is(capture: Capture) -> None:
    """Of 1 %, of which a frame's difference from the next shows 2 % at most."""
    weak = Flickering(capture, swing=0.005)
    same, light = even(weak)
    assert same is weak
    np.testing.assert_array_equal(light, EVEN_LIGHT)


def test_light_that_falls_off_is_found_behind_the_bands(capture: Capture) -> None:
    _, ((corners, _, found),) = even(Flickering(LampLit(capture)))
    assert found > 0
    assert corners == pytest.approx(float(lamp(np.array(1.0))), rel=0.1)


def test_a_lamp_on_the_camera_is_no_band(capture: Capture) -> None:
    assert even(LampLit(capture))[1][0, 2] == 0


def place(seed: int, swing: float, noise: float) -> list[Changes]:
    """Two pairs of frames: 200 points each that moved a little."""
    rng = np.random.default_rng(seed)
    pairs = []
    for _ in range(2):
        a = rng.uniform(0, 1, 200)
        b = a + rng.normal(0, 0.01, 200)
        lights = [np.log(bands(y, 4.0, k, swing)) for y, k in ((a, 0), (b, 1))]
        change = lights[1] - lights[0] + noise * rng.standard_normal(200)
        pairs.append(Changes(a, b, a, b, change))
    return pairs


def test_bands_count_where_they_explain_most_changes() -> None:
    """A wave to and from changes by 0.13 in the root mean square: 2 sin(0.37 pi) 0.1 / sqrt(2)."""
    assert bands_of([place(k, SWING, 0.1) for k in range(10)]) == pytest.approx(4.0, abs=0.05)
    assert bands_of([place(k, SWING, 0.2) for k in range(10)]) is None


def test_too_few_places_tell_of_no_bands() -> None:
    assert bands_of([place(k, SWING, 0.01) for k in range(7)] + [[]] * 5) is None


def test_points_that_change_by_nothing_tell_of_no_bands() -> None:
    still = np.linspace(0, 1, 50)
    assert bands_of([[Changes(still, still, still, still, np.zeros(50))]] * 10) is None


def test_an_image_without_bands_hardly_changes() -> None:
    """Noise has a wave of 1 / sqrt(32 columns x 120 rows) of its own 5 %, twice."""
    rng = np.random.default_rng(0)
    plain = np.clip(rng.normal(120, 6, (120, 160, 3)), 0, 255).astype(np.uint8)
    off = without_bands(plain, 3.3).astype(float) - plain
    assert np.abs(off).max() <= 1
