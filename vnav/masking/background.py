"""Two Gaussians of brightness a block, which move with the camera: 003 S33, S34.

Where the page gives no constants they are those of Yi et al. 2013, "Detection of moving objects
with non-stationary cameras in 5.8 ms".
"""

from dataclasses import dataclass

import cv2
import numpy as np

from vnav.compiled import compiled
from vnav.core.arrays import Floats
from vnav.masking.view import AROUND, Blocks

MAX_AGE = 30.0
FIRST_VARIANCE = 20.0**2  # grey levels, of a block that is seen for the first time
MIN_VARIANCE = 5.0**2
MAX_VARIANCE, FORGETTING = 50.0**2, 0.001  # a model that mixes what differs more than that ages
FITS = 2.0  # variances: the model that is nearer than that is updated
DIFFERS = 4.0  # variances: what is farther off does not belong to the background
CLIPPED = 250.0  # grey level: what is as bright may be brighter
MAX_GAIN = 4.0  # of the exposure between two frames, or its inverse
MEAN, VARIANCE, AGE = range(3)


@dataclass(frozen=True)
class Background:
    """``models`` (2, 3, h, w): mean, variance and age of the background and of its candidate."""

    models: Floats

    @classmethod
    def unknown(cls, shape: tuple[int, ...]) -> "Background":
        """Of nothing seen yet: age 0 everywhere."""
        models = np.zeros((2, 3, *shape), np.float32)
        models[:, VARIANCE] = FIRST_VARIANCE
        return cls(models)

    def warped(self, places: Floats) -> "Background":
        """Each block's models as the mixture of those about its place (h, w, 2) before: S34."""
        return Background(_mixed(self.models, places))

    def adapted(self, grey: Floats) -> "Background":
        """With the exposure of an image (h, w): the median gain where the background is known."""
        mean, _, age = self.models[0]
        known = (age > 1) & (mean > 1) & (grey < CLIPPED) & (mean < CLIPPED)
        if not known.any():
            return self
        gain = np.clip(np.median(grey[known] / mean[known]), 1 / MAX_GAIN, MAX_GAIN)
        return Background(self.models * _of_brightness(float(gain)))

    def updated(self, grey: Floats) -> "Background":
        """With an image (h, w) of the same place: S33."""
        models = self.models.copy()
        _update(models, grey)
        return Background(models)

    def differs(self, grey: Floats) -> Blocks:
        """Blocks (h, w) that are not as bright as the background, nor are those beside them."""
        mean, variance, age = self.models[0]
        brightest, darkest = cv2.dilate(grey, AROUND), cv2.erode(grey, AROUND)
        off = mean - np.clip(mean, darkest, brightest)
        clipped = (brightest >= CLIPPED) & (mean >= CLIPPED)
        return np.asarray((off**2 > DIFFERS * variance) & (age > 1) & ~clipped)


def _of_brightness(gain: float) -> Floats:
    """What mean, variance and age are multiplied by."""
    return np.array([gain, gain**2, 1], np.float32).reshape(1, 3, 1, 1)


@compiled
def _mixed(models: Floats, places: Floats) -> Floats:
    """S34, with the overlap of unit squares for weights; age 0 where a place is unknown."""
    result = np.zeros_like(models)
    result[:, VARIANCE] = FIRST_VARIANCE
    height, width = models.shape[2:]
    for v in range(height):
        for u in range(width):
            x, y = np.float64(places[v, u, 0]), np.float64(places[v, u, 1])
            if -1 < x < width and -1 < y < height:
                for m in range(2):
                    mean, variance, age = _mixture(models, m, x, y)
                    result[m, MEAN, v, u], result[m, VARIANCE, v, u] = mean, variance
                    result[m, AGE, v, u] = age
    return result


@compiled
def _mixture(models: Floats, m: int, x: float, y: float) -> tuple[float, float, float]:
    """Mean, variance and age under a unit square; what of it lies beyond the image has age 0."""
    height, width = models.shape[2:]
    left, top = int(np.floor(x)), int(np.floor(y))
    across, down = x - left, y - top
    total, mean, square, age = 1e-12, 0.0, 0.0, 0.0
    for k in range(4):
        row, column = top + k // 2, left + k % 2
        if 0 <= row < height and 0 <= column < width:
            share = (down if k // 2 else 1 - down) * (across if k % 2 else 1 - across)
            value = models[m, MEAN, row, column]
            total += share
            mean += share * value
            square += share * (models[m, VARIANCE, row, column] + value * value)
            age += share * models[m, AGE, row, column]
    mean /= total
    variance = square / total - mean * mean
    if variance > MAX_VARIANCE:
        age *= np.exp(-FORGETTING * (variance - MAX_VARIANCE))
    return mean, variance, age


@compiled
def _update(models: Floats, grey: Floats) -> None:
    """S33 in place. A block is one mean here, so that the farthest of its pixels is that."""
    height, width = grey.shape
    for v in range(height):
        for u in range(width):
            value = grey[v, u]
            if models[0, AGE, v, u] == 0:
                _start(models, 0, v, u, value)
            elif _fits(models, 0, v, u, value):
                _learn(models, 0, v, u, value)
            elif models[1, AGE, v, u] > 0 and _fits(models, 1, v, u, value):
                _learn(models, 1, v, u, value)
            else:
                _start(models, 1, v, u, value)
            if models[1, AGE, v, u] > models[0, AGE, v, u]:
                for k in range(3):
                    models[0, k, v, u] = models[1, k, v, u]
                _start(models, 1, v, u, 0.0)
                models[1, AGE, v, u] = 0


@compiled
def _fits(models: Floats, m: int, v: int, u: int, value: float) -> bool:
    return bool((value - models[m, MEAN, v, u]) ** 2 < FITS * models[m, VARIANCE, v, u])


@compiled
def _start(models: Floats, m: int, v: int, u: int, value: float) -> None:
    models[m, MEAN, v, u], models[m, VARIANCE, v, u] = value, FIRST_VARIANCE
    models[m, AGE, v, u] = 1


@compiled
def _learn(models: Floats, m: int, v: int, u: int, value: float) -> None:
    age = models[m, AGE, v, u]
    old = age / (age + 1)
    models[m, MEAN, v, u] = old * models[m, MEAN, v, u] + (1 - old) * value
    off = (value - models[m, MEAN, v, u]) ** 2
    variance = old * models[m, VARIANCE, v, u] + (1 - old) * off
    models[m, VARIANCE, v, u] = max(variance, MIN_VARIANCE)
    models[m, AGE, v, u] = min(age + 1, MAX_AGE)
