"""How far each cell is from the nearest occupied one."""

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Array


def distances(occupied: NDArray[np.bool_]) -> Array:
    """Distances between centres in cells, exact (Felzenszwalb, Huttenlocher 2012)."""
    return np.asarray(np.sqrt(_squared_distances(occupied)))


@compiled
def _squared_distances(occupied: NDArray[np.bool_]) -> Array:
    """First along each column, then along each row."""
    rows, columns = occupied.shape
    along, squared = np.full((rows, columns), np.inf), np.full((rows, columns), np.inf)
    for c in range(columns):
        for forth in (True, False):
            away = np.inf
            for k in range(rows):
                r = k if forth else rows - 1 - k
                away = 0.0 if occupied[r, c] else away + 1
                along[r, c] = min(along[r, c], away * away)
    lowest, begins = np.zeros(columns, np.int64), np.zeros(columns)
    for r in range(rows):
        _lower_envelope(along[r], lowest, begins, squared[r])
    return squared


@compiled
def _lower_envelope(
    heights: Array, lowest: NDArray[np.int64], begins: Array, result: Array
) -> None:
    """Enter the least of the parabolas ``heights[c] + (x - c)**2`` at each x.

    ``lowest`` and ``begins`` are room for which of them is the least from where on.
    """
    count = 0
    for c in range(len(heights)):
        if heights[c] == np.inf:
            continue
        begin = -np.inf
        while count > 0:
            last = lowest[count - 1]
            begin = (heights[c] - heights[last] + c * c - last * last) / (2 * (c - last))
            if begin > begins[count - 1]:
                break
            begin = -np.inf
            count -= 1
        lowest[count] = c
        begins[count] = begin
        count += 1
    k = 0
    for x in range(len(heights) if count > 0 else 0):
        while k + 1 < count and begins[k + 1] < x:
            k += 1
        away = x - lowest[k]
        result[x] = heights[lowest[k]] + away * away
