"""What pixels without depth say of a motion between two frames, as compiled loops.

Such a pixel's point lies somewhere on its ray, from `NEAREST` on, and meets on a line in the other
frame what looks the same.
"""

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Array, Floats
from vnav.registration.compiled_geometry import MIN_Z_M, Point
from vnav.registration.pixel_evidence import bilinear, depths_around, log_likelihood

NEAREST = 0.5  # 1/m: what is nearer than 2 m would have depth
APART_PX = 1.0  # along that line, from one distance to the next that is tried
MOST = 12  # distances that are tried


@compiled
def met_far(
    T_b_a: Array,
    b: Floats,
    cameras: Array,
    pixels: NDArray[np.int64],
    sigmas: Array,
) -> Array:
    """What pixels (N, 2) of a may meet in b, by distance: (N, D, 2).

    b's brightness and its standard deviation by noise. NaN where there is nothing to compare: a
    place outside b, or one with depth, whose surface is another one. The first is infinitely far.
    ``b`` (H, W, 2): inverse depth, 0 for none, and brightness; ``cameras`` and ``sigmas`` as
    `pixel_evidence.carried` takes them.
    """
    count = _distances(T_b_a, cameras, pixels)
    met = np.full((len(pixels), count, 2), np.nan)
    here, there = cameras[0], cameras[1]
    for n in range(len(pixels)):
        ray = _turned(T_b_a, here, pixels[n])
        for d in range(count):
            w = NEAREST * d / max(count - 1, 1)
            z = ray[2] + w * T_b_a[2, 3]
            if z <= MIN_Z_M:
                continue
            u = there[0] * (ray[0] + w * T_b_a[0, 3]) / z + there[2]
            v = there[1] * (ray[1] + w * T_b_a[1, 3]) / z + there[3]
            if depths_around(b, u, v) == 0:
                brightness, across, down = bilinear(b, 1, u, v)
                edge = across**2 + down**2
                place = sigmas[0] ** 2 + APART_PX**2 / 12
                met[n, d] = brightness, np.sqrt(2 * sigmas[2] ** 2 + place * edge)
    return met


@compiled
def far_log_likelihoods(
    met: Array,
    brightness: Array,
    cells: NDArray[np.int64],
    light: tuple[float, float],
    chance: float,
    wrong: float,
) -> Array:
    """Of pixels (N,) meeting what they met, over that of meeting others by chance.

    At the distance that explains all pixels of their cell best, as surfaces are: were each as far
    away as it likes, a motion that moves little would win. ``met`` from `met_far`; the others as
    `pixel_evidence.log_likelihoods` takes them. NaN for pixels that met nothing there.
    """
    gain, offset = light
    told = np.full(met.shape[:2], np.nan)
    total = np.zeros((cells.max() + 1 if len(cells) else 0, met.shape[1]))
    for n in range(len(met)):
        for d in range(met.shape[1]):
            if not np.isnan(met[n, d, 0]):
                off = met[n, d, 0] - gain * brightness[n] - offset
                told[n, d] = log_likelihood(off, met[n, d, 1], 0.0, chance, wrong)
                total[cells[n], d] += told[n, d]
    found = np.full(len(met), np.nan)
    for n in range(len(met)):
        found[n] = told[n, total[cells[n]].argmax()]
    return found


@compiled
def _distances(T_b_a: Array, cameras: Array, pixels: NDArray[np.int64]) -> int:
    """How many distances are tried, so that they are `APART_PX` from each other in b."""
    here, there = cameras[0], cameras[1]
    farthest = 0.0
    for n in range(len(pixels)):
        ray = _turned(T_b_a, here, pixels[n])
        z = ray[2] + NEAREST * T_b_a[2, 3]
        if ray[2] > MIN_Z_M and z > MIN_Z_M:
            across = (ray[0] + NEAREST * T_b_a[0, 3]) / z - ray[0] / ray[2]
            down = (ray[1] + NEAREST * T_b_a[1, 3]) / z - ray[1] / ray[2]
            farthest = max(farthest, np.hypot(there[0] * across, there[1] * down))
    return int(min(np.ceil(farthest / APART_PX) + 1, MOST))


@compiled
def _turned(T_b_a: Array, camera: Array, pixel: NDArray[np.int64]) -> Point:
    """The ray of a pixel as b has it."""
    x, y = (pixel[0] - camera[2]) / camera[0], (pixel[1] - camera[3]) / camera[1]
    return (
        T_b_a[0, 0] * x + T_b_a[0, 1] * y + T_b_a[0, 2],
        T_b_a[1, 0] * x + T_b_a[1, 1] * y + T_b_a[1, 2],
        T_b_a[2, 0] * x + T_b_a[2, 1] * y + T_b_a[2, 2],
    )
