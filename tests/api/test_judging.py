"""What `vnav check` says of the light of a capture."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import vnav
from tests.lighting.lamp import Flickering, LampLit, lamp
from vnav.checking.capture_report import summary
from vnav.config import CaptureConfig, Config
from vnav.io.sources.capture import Capture
from vnav.io.sources.subset import Subset
from vnav.lighting.flattened import light_of


@pytest.fixture(scope="module")
def by_a_lamp(capture: Capture) -> Capture:
    return LampLit(capture)


def told(report: object) -> list[str]:
    """What the summary says of the light."""
    return [line for line in summary(report) if line.startswith("light")]


def test_a_lamp_on_the_camera_is_told(by_a_lamp: Capture) -> None:
    with ThreadPoolExecutor(2) as pool:
        profile = light_of(by_a_lamp, pool).profile
    report = vnav.check(by_a_lamp)
    assert profile is not None
    assert report.corners is not None
    # 4 standard deviations, and half a grey level of the 100 of a usual one: they are rounded
    bound = 4 * profile.sigma(1.0) + 0.005
    assert abs(np.log(report.corners / lamp(np.array(1.0)))) < bound < 0.2
    assert told(report) == [
        f"light    falls to {report.corners:.0%} at the corners: it will be taken off"
    ]
    assert report.as_dict()["corners"] == report.corners


def test_even_light_is_told(capture: Capture) -> None:
    report = vnav.check(capture)
    assert report.corners == 1.0
    assert told(report) == ["light    does not fall off by what would harm a map"]


def test_lamps_that_flicker_are_told(capture: Capture) -> None:
    report = vnav.check(Flickering(capture))
    assert report.bands is not None
    assert told(report) == [
        "light    does not fall off by what would harm a map",
        f"light    flickers, {report.bands:.1f} bands to an image: they will be taken off",
    ]
    assert report.as_dict()["bands"] == report.bands


def test_nothing_is_said_of_light_that_is_left_as_it_is(by_a_lamp: Capture) -> None:
    config = Config(capture=CaptureConfig(flatten="off"))
    report = vnav.check(by_a_lamp, config=config)
    assert report.corners is None
    assert told(report) == []


def test_nothing_is_said_of_light_that_too_few_frames_tell(by_a_lamp: Capture) -> None:
    report = vnav.check(Subset(by_a_lamp, range(20)))
    assert report.corners is None
    assert told(report) == []
