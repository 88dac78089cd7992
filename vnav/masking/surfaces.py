"""Surfaces of a view: blocks joined over depth that has neither steps nor inner edges.

A body that stands on a floor or against a wall meets it in an edge that is concave, and a body's
own edges are mostly convex. So a surface is of one body, as in Ruenz, Buffier and Agapito 2018,
"MaskFusion", section 5.2. Noise leaves gaps in such an edge, as between a heel and the floor. What
joins two parts over less than three blocks does not make them one.
"""

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Array, Floats
from vnav.core.reduced_frame import ReducedFrame

STEP_M = 0.05  # between neighbours on one surface
MAX_ENDS = 2  # of 12 joints between a block and those around it
MIN_COSINE = 0.95  # of the normals on either side of what is no edge: 18 degrees


def surfaces(frame: ReducedFrame) -> NDArray[np.int32]:
    """The number of each block's surface (h, w), from 1; 0 where there is no depth."""
    inverse_depth = frame.inverse_depth
    rows, columns = np.indices(inverse_depth.shape)
    depth = np.divide(1, inverse_depth, out=np.zeros(rows.shape), where=inverse_depth > 0)
    points = frame.intrinsics.unproject(np.stack([columns, rows], -1), depth)
    return _numbered(_joined(points, _normals(points, inverse_depth), inverse_depth), inverse_depth)


@compiled
def is_step(inverse_depth: float, other: float) -> bool:
    """Whether a surface ends between two neighbours, or has ended: 0 is no depth."""
    return bool(abs(inverse_depth - other) >= STEP_M * inverse_depth * other)


@compiled
def _normals(points: Array, inverse_depth: Floats) -> Array:
    """Of each block (h, w, 3), by the neighbours on its surface; 0 where these are too few."""
    height, width = inverse_depth.shape
    normals, along = np.zeros(points.shape), np.zeros((2, 3))
    for v in range(height):
        for u in range(width):
            here = inverse_depth[v, u]
            if here == 0:
                continue
            for k in range(2):
                i, j = min(v + k, height - 1), min(u + 1 - k, width - 1)
                v0, u0 = max(v - k, 0), max(u - 1 + k, 0)
                if is_step(here, inverse_depth[i, j]):
                    i, j = v, u
                if is_step(here, inverse_depth[v0, u0]):
                    v0, u0 = v, u
                for d in range(3):
                    along[k, d] = points[i, j, d] - points[v0, u0, d]
            squared = 0.0
            for d in range(3):
                e, f = (d + 1) % 3, (d + 2) % 3
                across = along[1, e] * along[0, f] - along[1, f] * along[0, e]
                normals[v, u, d] = across
                squared += across * across
            if squared > 0:
                for d in range(3):
                    normals[v, u, d] /= np.sqrt(squared)
    return normals


@compiled
def _joined(points: Array, normals: Array, inverse_depth: Floats) -> NDArray[np.bool_]:
    """Which blocks (h, w, 2) are on one surface with the next to the right, and with that below."""
    height, width = inverse_depth.shape
    joined = np.zeros((height, width, 2), np.bool_)
    for v in range(height):
        for u in range(width):
            for k in range(2):
                i, j = v + k, u + 1 - k
                if i < height and j < width:
                    ends = is_step(inverse_depth[v, u], inverse_depth[i, j])
                    joined[v, u, k] = not (ends or _is_edge(points, normals, v, u, i, j))
    return joined


@compiled
def _is_edge(points: Array, normals: Array, v: int, u: int, i: int, j: int) -> bool:
    """Whether the surface bends inwards between two neighbours, by the blocks beyond either."""
    v0, u0 = _beyond(normals, v, u, i, j)
    i0, j0 = _beyond(normals, i, j, v, u)
    if not (_is_known(normals, v0, u0) and _is_known(normals, i0, j0)):
        return True
    bends, cosine = 0.0, 0.0
    for d in range(3):
        first, second = normals[v0, u0, d], normals[i0, j0, d]
        bends += (second - first) * (points[i0, j0, d] - points[v0, u0, d])
        cosine += first * second
    return bool(bends < 0 and cosine < MIN_COSINE)


@compiled
def _beyond(normals: Array, v: int, u: int, i: int, j: int) -> tuple[int, int]:
    """The block on the far side of v, u from its neighbour, or v, u where that has no normal."""
    height, width = normals.shape[:2]
    i, j = 2 * v - i, 2 * u - j
    if 0 <= i < height and 0 <= j < width and _is_known(normals, i, j):
        return i, j
    return v, u


@compiled
def _is_known(normals: Array, v: int, u: int) -> bool:
    return bool(normals[v, u, 0] != 0 or normals[v, u, 1] != 0 or normals[v, u, 2] != 0)


@compiled
def _numbered(joined: NDArray[np.bool_], inverse_depth: Floats) -> NDArray[np.int32]:
    """By what is joined over more than two blocks; what is narrower is of what it begins at."""
    numbers = np.zeros(inverse_depth.shape, np.int32)
    known = inverse_depth > 0
    _number(numbers, joined, known & _inner(joined))
    _flood(numbers, joined, known, np.argwhere(numbers > 0))
    _number(numbers, joined, known)
    return numbers


@compiled
def _inner(joined: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Blocks (h, w) about which nearly all neighbours are joined."""
    height, width = joined.shape[:2]
    inner = np.zeros((height, width), np.bool_)
    for v in range(height):
        for u in range(width):
            ends = 0
            for i in range(max(v - 1, 0), min(v + 2, height)):
                for j in range(max(u - 1, 0), min(u + 2, width)):
                    ends += i + 1 < min(v + 2, height) and not joined[i, j, 1]
                    ends += j + 1 < min(u + 2, width) and not joined[i, j, 0]
            inner[v, u] = ends <= MAX_ENDS
    return inner


@compiled
def _number(
    numbers: NDArray[np.int32], joined: NDArray[np.bool_], within: NDArray[np.bool_]
) -> None:
    """Give each connected part of the blocks within, as far as it has none, a number of its own."""
    height, width = numbers.shape
    last = numbers.max()
    for v in range(height):
        for u in range(width):
            if within[v, u] and numbers[v, u] == 0:
                last += 1
                numbers[v, u] = last
                _flood(numbers, joined, within, np.array([[v, u]]))


@compiled
def _flood(
    numbers: NDArray[np.int32],
    joined: NDArray[np.bool_],
    within: NDArray[np.bool_],
    begins: NDArray[np.intp],
) -> None:
    """Breadth first from blocks (N, 2) to those within that are joined and have no number."""
    height, width = numbers.shape
    queue, begin, end = np.empty((numbers.size, 2), np.int64), 0, len(begins)
    queue[:end] = begins
    while begin < end:
        v, u = queue[begin]
        begin += 1
        for dv, du in ((0, 1), (1, 0), (0, -1), (-1, 0)):
            i, j = v + dv, u + du
            if not (0 <= i < height and 0 <= j < width) or numbers[i, j] > 0:
                continue
            if joined[min(v, i), min(u, j), abs(dv)] and within[i, j]:
                numbers[i, j] = numbers[v, u]
                queue[end, 0], queue[end, 1] = i, j
                end += 1
