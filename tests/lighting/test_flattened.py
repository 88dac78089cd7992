"""Captures of a rendered room by a camera with a lamp: the light is found, and taken off."""

import dataclasses
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from tests.lighting.lamp import LampLit, lamp, squares
from vnav.core.frame import Frame
from vnav.core.mapping import EVEN_LIGHT
from vnav.errors import CaptureError
from vnav.io.sources.capture import Capture
from vnav.io.sources.subset import Subset
from vnav.lighting.falloff import LightProfile
from vnav.lighting.flattened import MOST_GAIN, Flattened, flattened, light_of

R2 = np.linspace(0.1, 1, 10)


class Frozen(LampLit):
    """A lamp's capture by a camera that stands still."""

    def read(self, index: int) -> Frame:
        return super().read(10)


class Damaged(LampLit):
    """A lamp's capture of which the first frames cannot be read."""

    def read(self, index: int) -> Frame:
        if index < 10:
            raise CaptureError("expected an image, found none")
        return super().read(index)


class Plain(LampLit):
    """A capture of one grey level."""

    def __init__(self, whole: Capture, value: int) -> None:
        super().__init__(whole)
        self._value = value

    def read(self, index: int) -> Frame:
        frame = self.whole.read(index)
        return dataclasses.replace(frame, color=np.full_like(frame.color, self._value))


@pytest.fixture(scope="module")
def profile(capture: Capture) -> LightProfile:
    found = light(LampLit(capture))
    assert found is not None
    return found


def light(capture: Capture, threads: int = 2) -> LightProfile | None:
    with ThreadPoolExecutor(threads) as pool:
        return light_of(capture, pool).profile


def even(capture: Capture) -> tuple[Capture, np.ndarray]:
    with ThreadPoolExecutor(2) as pool:
        return flattened(capture, pool)


def test_the_falloff_of_a_lamp_is_found_as_surely_as_it_says(profile: LightProfile) -> None:
    # 4 standard deviations, and half a grey level of the 100 of a usual one: they are rounded
    bound = [4 * profile.sigma(r2) + 0.005 for r2 in R2]
    assert (np.abs(np.log(profile.brightness(R2) / lamp(R2))) < bound).all()
    assert profile.sigma(0.75**2) < 0.005
    assert profile.is_strong


def test_a_capture_of_even_light_is_left_as_it_is(capture: Capture) -> None:
    same, found = even(capture)
    assert same is capture
    np.testing.assert_array_equal(found, EVEN_LIGHT)


def test_light_that_falls_off_by_little_is_left(capture: Capture) -> None:
    weak = LampLit(capture, lambda r2: 1 - 0.16 * r2)  # 0.91 at three quarters; 0.87 is the limit
    assert even(weak)[0] is weak


def test_the_profile_is_the_same_whatever_the_number_of_threads(
    capture: Capture, profile: LightProfile
) -> None:
    again = light(LampLit(capture), threads=5)
    assert again is not None
    assert again.drops.tobytes() == profile.drops.tobytes()
    assert again.covariance.tobytes() == profile.covariance.tobytes()


def test_a_camera_that_stands_still_tells_nothing_of_its_light(capture: Capture) -> None:
    still = Frozen(capture)
    assert even(still)[0] is still


def test_progress_ends_at_the_last_place(capture: Capture) -> None:
    seen: list[tuple[str, int, int]] = []
    with ThreadPoolExecutor(2) as pool:
        light_of(capture, pool, lambda *step: seen.append(step))
    assert seen == [("measuring light", k, 12) for k in range(1, 13)]  # one for every 5 frames


def test_a_few_frames_tell_nothing_and_are_not_read(capture: Capture) -> None:
    few = Subset(Damaged(capture), range(39))
    assert even(few)[0] is few


def test_frames_that_cannot_be_read_are_left_out(capture: Capture) -> None:
    changed, found = even(Damaged(capture))
    assert isinstance(changed, Flattened)
    left, sigma, _ = found[0]
    assert abs(np.log(left / lamp(np.array(1.0)))) < 4 * sigma + 0.005


def test_frames_are_then_as_without_the_lamp(capture: Capture, profile: LightProfile) -> None:
    lit = LampLit(capture)
    frame, truth = Flattened(lit, profile).read(7), capture.read(7)
    off = frame.color.astype(float) - truth.color
    # noise of 2 grey levels and rounding, up to 1 / 0.3 times; the profile errs by 1 % at most
    bound = 5 * 2.1 / lamp(squares(*truth.depth_m.shape))[..., None] + 0.01 * truth.color + 1
    assert (np.abs(off) < bound).mean() > 0.9999
    assert abs(off.mean()) < 1
    np.testing.assert_array_equal(frame.depth_m, truth.depth_m)
    assert (frame.index, frame.stamp_s) == (7, truth.stamp_s)


@pytest.mark.parametrize(("value", "in_corners"), [(255, 255), (10, round(10 * MOST_GAIN))])
def test_what_is_clipped_stays_so_and_no_gain_is_too_great(
    capture: Capture, value: int, in_corners: int
) -> None:
    steep = LightProfile(np.full(5, 2.0), np.zeros((5, 5)))
    color = Flattened(Plain(capture, value), steep).read(0).color
    height, width = color.shape[:2]
    assert color[0, 0].tolist() == [in_corners] * 3
    assert np.abs(color[height // 2, width // 2].astype(int) - value).max() <= 1


def test_it_is_the_same_capture_to_a_map(capture: Capture, profile: LightProfile) -> None:
    lit = LampLit(capture)
    even = Flattened(lit, profile)
    assert even.fingerprint() == lit.fingerprint()
    assert (even.name, even.camera, len(even)) == (lit.name, lit.camera, len(lit))
    assert (even.has_depth, even.poses) == (lit.has_depth, lit.poses)
    np.testing.assert_array_equal(even.stamps_s, lit.stamps_s)
