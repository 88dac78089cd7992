"""FAST corners with the edge rule and the non-maxima of [000 section 1].

Sources: Rosten, Drummond, "Machine learning for high-speed corner detection", 2006; [000 eq 1 to
3]. The text's tests are mended: an arc is contiguous and may be brighter or darker, the pretest
asks two of four pixels where an arc of nine is sought, and the edge rule takes absolute values.
"""

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Floats

RADIUS = 3
CIRCLE = np.array(
    [(0, -3), (1, -3), (2, -2), (3, -1), (3, 0), (3, 1), (2, 2), (1, 3)]
    + [(0, 3), (-1, 3), (-2, 2), (-3, 1), (-3, 0), (-3, -1), (-2, -2), (-1, -3)]
)  # x, y of pixels 1 to 16, clockwise from the top


def corners(
    gray: NDArray[np.uint8], threshold: int, arc: int, edge_limit: int
) -> tuple[Floats, Floats]:
    """Places (N, 2), x and y, and strengths (N,) of the corners of an image (H, W), row by row.

    Of those that `strengths` finds the strongest of 3 x 3 pixels stays: eq 3.
    """
    strength = strengths(gray, threshold, arc, edge_limit)
    rows, columns = _maxima(strength)
    return np.stack([columns, rows], 1).astype(np.float32), strength[rows, columns]


def strengths(gray: NDArray[np.uint8], threshold: int, arc: int, edge_limit: int) -> Floats:
    """The strength of each pixel (H, W) that is a corner, 0 elsewhere.

    A corner has ``arc`` pixels side by side on its circle (9 to 12) that are all brighter, or all
    darker, by ``threshold``: eq 1. One whose circle has more than ``edge_limit`` pixels that look
    like both their neighbours lies on an edge: eq 2; 16 keeps all. The strength is the absolute
    sum of second differences across the circle.
    """
    found: Floats = _strengths(np.ascontiguousarray(gray), CIRCLE, threshold, arc, edge_limit)
    return found


@compiled
def _strengths(
    gray: NDArray[np.uint8],
    circle: NDArray[np.int64],
    threshold: int,
    arc: int,
    edge_limit: int,
) -> Floats:
    """See `strengths`."""
    height, width = gray.shape
    strength = np.zeros((height, width), np.float32)
    ring = np.empty(16, np.int64)
    wanted = arc // 4  # of four, an arc of 9 may cover only two
    for y in range(RADIUS, height - RADIUS):
        for x in range(RADIUS, width - RADIUS):
            centre = np.int64(gray[y, x])
            brighter, darker = np.int64(0), np.int64(0)
            for k in range(0, 16, 4):
                off = np.int64(gray[y + circle[k, 1], x + circle[k, 0]]) - centre
                brighter += off >= threshold
                darker += off <= -threshold
            if brighter < wanted and darker < wanted:
                continue
            for k in range(16):
                ring[k] = gray[y + circle[k, 1], x + circle[k, 0]]
            if _longest_arc(ring - centre, threshold) >= arc and not _on_edge(
                ring, threshold, edge_limit
            ):
                strength[y, x] = abs(ring.sum() - 16 * centre)
    return strength


@compiled
def _longest_arc(off: NDArray[np.int64], threshold: int) -> int:
    """Most pixels side by side that are all brighter, or all darker, than the centre."""
    longest = 0
    for sign in (1, -1):
        run = 0
        for k in range(32):  # twice around: an arc may pass the top
            run = run + 1 if sign * off[k % 16] >= threshold else 0
            longest = max(longest, min(run, 16))
    return longest


@compiled
def _on_edge(ring: NDArray[np.int64], threshold: int, limit: int) -> bool:
    """Whether too many pixels of the circle look like both of their neighbours."""
    alike = 0
    for k in range(16):
        before, after = abs(ring[k] - ring[k - 1]), abs(ring[k] - ring[(k + 1) % 16])
        alike += before < threshold and after < threshold
    return alike > limit


@compiled
def _maxima(strength: Floats) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns where none of the eight neighbours is stronger; of equal ones the first."""
    rows, columns = np.nonzero(strength)
    kept = np.ones(len(rows), np.bool_)
    for n in range(len(rows)):
        y, x = rows[n], columns[n]
        for v in range(y - 1, y + 2):
            for u in range(x - 1, x + 2):
                before = v < y or (v == y and u < x)
                other = strength[v, u]
                if other > strength[y, x] or (before and other == strength[y, x]):
                    kept[n] = False
    return rows[kept], columns[kept]
