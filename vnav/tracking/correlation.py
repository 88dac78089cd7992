"""Zero-mean normalised cross-correlation of small templates: [000 eq 4]."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Array, Floats

REACH_PX = 5
TEMPLATE_PX = 2 * REACH_PX + 1
LEAST_CONTRAST = 1.0  # square root of the sum of squares: one pixel differs by a grey level

MIN_CORRELATION = 0.8  # of a template and of what it was found to be


@compiled
def normalised(template: Array | Floats) -> bool:
    """Give a template (11, 11) mean 0 and length 1, in place; False where it is flat or NaN."""
    template -= template.mean()
    length = np.sqrt((template * template).sum())
    if not length >= LEAST_CONTRAST:
        return False
    template /= length
    return True


@compiled
def correlation(image: NDArray[Any], template: Array | Floats, u: int, v: int) -> float:
    """Of a normalised template with an image around a pixel; -1 at its edge, or where it is flat.

    Summed with the precision of the template.
    """
    height, width = image.shape
    if not (REACH_PX <= u < width - REACH_PX and REACH_PX <= v < height - REACH_PX):
        return -1.0
    number = template.dtype.type
    product, total, square = number(0), number(0), number(0)
    for i in range(TEMPLATE_PX):
        row = image[v - REACH_PX + i]
        for j in range(TEMPLATE_PX):
            value = number(row[u - REACH_PX + j])
            product += template[i, j] * value
            total += value
            square += value * value
    contrast = square - total * total / number(TEMPLATE_PX**2)
    if contrast < LEAST_CONTRAST**2:
        return -1.0
    return float(product / np.sqrt(contrast))


@compiled
def peak(
    image: NDArray[Any], template: Array | Floats, u: int, v: int, top: float
) -> tuple[float, float]:
    """How far beside a pixel, at most half of one, the correlation is highest.

    By a parabola along either axis; ``top``: the correlation at the pixel.
    """
    return (
        _offset(
            correlation(image, template, u - 1, v), top, correlation(image, template, u + 1, v)
        ),
        _offset(
            correlation(image, template, u, v - 1), top, correlation(image, template, u, v + 1)
        ),
    )


@compiled
def _offset(before: float, here: float, after: float) -> float:
    """Where between -0.5 and 0.5 the parabola through three values is highest."""
    bend = before - 2 * here + after
    if before == -1 or after == -1 or not bend < 0:
        return 0.0
    return min(0.5, max(-0.5, 0.5 * (before - after) / bend))
