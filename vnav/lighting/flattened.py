"""A capture without the falloff of its light, and without bands of flickering light."""

import dataclasses
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from vnav.core.arrays import Floats
from vnav.core.frame import Frame
from vnav.core.mapping import EVEN_LIGHT
from vnav.core.progress import Progress, silent
from vnav.errors import CaptureError
from vnav.io.sources.capture import Capture
from vnav.io.sources.derived import DerivedCapture
from vnav.lighting.falloff import LEAST_PLACES, Changed, LightProfile, fitted
from vnav.lighting.flicker import bands_of, without_bands
from vnav.lighting.followed_points import changes, lit_image
from vnav.threads import one_opencv_thread

PLACES = 24  # of the capture at which frames are compared, evenly
STEPS = 0, 1, 4  # frames of a place: the first is compared with the others
MOST_GAIN = 10.0  # more would make images of noise; with 4, light that is left harms: docs/log.md


class Flattened(DerivedCapture):
    """The frames of a capture, each colour divided by how bright the light is there.

    Its fingerprint is that of the capture: what the light is follows from the frames.
    """

    def __init__(self, capture: Capture, profile: LightProfile) -> None:
        super().__init__(capture)
        self._gain = lru_cache(4)(lambda size: _gain(size, profile))

    def read(self, index: int) -> Frame:
        """A frame of the capture, evenly lit; what is clipped stays clipped."""
        frame = super().read(index)
        gain = self._gain(frame.color.shape[:2])
        color = cv2.multiply(np.asarray(frame.color), gain, dtype=cv2.CV_8U)
        return dataclasses.replace(frame, color=color)


class Steady(DerivedCapture):
    """The frames of a capture under lamps that flicker, without the bands."""

    def __init__(self, capture: Capture, bands: float) -> None:
        super().__init__(capture)
        self._bands = bands

    def read(self, index: int) -> Frame:
        """A frame of the capture, evenly lit."""
        frame = super().read(index)
        return dataclasses.replace(frame, color=without_bands(frame.color, self._bands))


def _gain(size: tuple[int, int], profile: LightProfile) -> Floats:
    """What colour (H, W, 3) is multiplied by."""
    height, width = size
    x, y = np.arange(width) - (width - 1) / 2, np.arange(height) - (height - 1) / 2
    r2 = (x**2 + y[:, None] ** 2) / max(x[0] ** 2 + y[0] ** 2, 1)
    gain = np.minimum(1 / profile.brightness(r2), MOST_GAIN).astype(np.float32)
    return np.repeat(gain[..., None], 3, -1)


@dataclass(frozen=True)
class Light:
    """What a capture's light does: how it falls off, and how many bands lie over an image.

    ``profile`` is None where too few frames tell; ``bands`` is 0 where lamps do not flicker.
    """

    profile: LightProfile | None
    bands: float

    @property
    def corners(self) -> float | None:
        """How bright the corners are, 1 in the centre and where that would not harm a map.

        None where it cannot be told.
        """
        if self.profile is None:
            return None
        return float(self.profile.brightness(1.0)) if self.profile.is_strong else 1.0


def flattened(
    capture: Capture, pool: ThreadPoolExecutor, progress: Progress = silent
) -> tuple[Capture, Floats]:
    """The capture without what its light does, and what that was, as `Odometry.light` says.

    The capture itself where light does not fall off surely and strongly, and does not flicker.
    """
    light, taken_off = light_of(capture, pool, progress), EVEN_LIGHT.copy()
    if light.bands > 0:
        capture, taken_off[0, 2] = Steady(capture, light.bands), light.bands
    if light.profile is not None and light.profile.is_strong:
        capture = Flattened(capture, light.profile)
        taken_off[0, :2] = light.corners, light.profile.sigma(1.0)
    return capture, taken_off


def light_of(capture: Capture, pool: ThreadPoolExecutor, progress: Progress = silent) -> Light:
    """The light of a capture, by some of its frames; even where they are too few to tell."""
    places = _changes_of(capture, pool, progress)
    bands = bands_of(places)
    if bands is None:
        return Light(fitted(places), 0.0)
    places = _changes_of(Steady(capture, bands), pool, progress)  # what bands have hidden
    return Light(fitted(places), bands)


def _changes_of(
    capture: Capture, pool: ThreadPoolExecutor, progress: Progress
) -> Sequence[Changed]:
    """How points changed at some places of a capture, none where that has too few frames.

    A place with a frame that cannot be read has none.
    """
    places = min(PLACES, len(capture) // (STEPS[-1] + 1))
    if places < LEAST_PLACES:
        return []
    first = np.linspace(0, len(capture) - 1 - STEPS[-1], places).astype(int)
    found = []
    with one_opencv_thread:
        for place in pool.map(lambda row: _place(capture, row), first.tolist()):
            found.append(place)
            progress("measuring light", len(found), places)
    return found


def _place(capture: Capture, row: int) -> Changed:
    """How points changed from a frame to those soon after."""
    try:
        seen = [lit_image(capture.read(row + k).color) for k in STEPS]
    except CaptureError:
        return []
    found = [changes(seen[0], other) for other in seen[1:]]
    return [change for change in found if change is not None]
