"""Times that belong together."""

import numpy as np
from numpy.typing import NDArray


def associate(
    stamps_a: NDArray[np.float64], stamps_b: NDArray[np.float64], largest_s: float
) -> NDArray[np.intp]:
    """Rows (M, 2) of two lists of times that belong together, one to one, in order of a.

    The smallest differences are taken first, each below ``largest_s``, as the TUM benchmark's
    associate.py does. Times need not be sorted.
    """
    a, b = np.asarray(stamps_a, float), np.asarray(stamps_b, float)
    order_b = np.argsort(b, kind="stable")
    first = np.searchsorted(b[order_b], a - largest_s)
    count = np.searchsorted(b[order_b], a + largest_s, "right") - first
    row_a = np.repeat(np.arange(len(a)), count)
    within = np.arange(len(row_a)) - np.repeat(np.cumsum(count) - count, count)
    row_b = order_b[np.repeat(first, count) + within]
    differences = np.abs(a[row_a] - b[row_b])
    free_a, free_b = [True] * len(a), [True] * len(b)
    matches = []
    for k in np.lexsort((b[row_b], a[row_a], differences)):
        i, j = row_a[k], row_b[k]
        if differences[k] < largest_s and free_a[i] and free_b[j]:
            free_a[i] = free_b[j] = False
            matches.append((i, j))
    return np.array(sorted(matches), np.intp).reshape(-1, 2)


def span(stamps_s: NDArray[np.float64]) -> str:
    """First and last of some times, for a person."""
    if not len(stamps_s):
        return "no time at all"
    return f"{np.min(stamps_s):.3f} to {np.max(stamps_s):.3f} s"
