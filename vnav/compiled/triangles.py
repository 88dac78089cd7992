"""Axes of a triangle: with those that it has elsewhere, they tell how it was turned."""

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled

Array = NDArray[np.float64]


@compiled
def fill_axes(points: Array, axes: Array) -> None:
    """Fill the orthonormal axes (3, 3), as rows, of a triangle (3, 3); the last is its normal.

    NaN where its points lie on a line.
    """
    for k in range(3):
        axes[0, k] = points[1, k] - points[0, k]
        axes[1, k] = points[2, k] - points[0, k]
    _cross(axes[0], axes[1], axes[2])
    for k in (0, 2):
        length = np.sqrt(dot(axes[k], axes[k]))
        for n in range(3):
            axes[k, n] /= length
    _cross(axes[2], axes[0], axes[1])


@compiled
def dot(a: Array, b: Array) -> float:
    """Of the first three numbers."""
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@compiled
def _cross(a: Array, b: Array, product: Array) -> None:
    product[0] = a[1] * b[2] - a[2] * b[1]
    product[1] = a[2] * b[0] - a[0] * b[2]
    product[2] = a[0] * b[1] - a[1] * b[0]
