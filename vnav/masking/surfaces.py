"""Surfaces of a view: blocks joined over depth that has neither steps nor inner edges.

A body that stands on a floor or against a wall meets it in an edge that is concave, and a body's
own edges are mostly convex. So a surface is of one body, as in Ruenz, Buffier and Agapito 2018,
"MaskFusion", section 5.2.
"""

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Array, Floats
from vnav.core.reduced_frame import ReducedFrame

STEP_M = 0.05  # between neighbours on one surface
MIN_COSINE = 0.95  # of the normals on either side of what is no edge: 18 degrees


def surfaces(frame: ReducedFrame) -> NDArray[np.int32]:
    """The number of each block's surface (h, w), from 1; 0 where there is no depth."""
    inverse_depth = frame.inverse_depth
    rows, columns = np.indices(inverse_depth.shape)
    depth = np.divide(1, inverse_depth, out=np.zeros(rows.shape), where=inverse_depth > 0)
    points = frame.intrinsics.unproject(np.stack([columns, rows], -1), depth)
    return _numbered(points, _normals(points, inverse_depth), inverse_depth)


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
            for k, (dv, du) in enumerate(((0, 1), (1, 0))):
                i, j = min(v + dv, height - 1), min(u + du, width - 1)
                v0, u0 = max(v - dv, 0), max(u - du, 0)
                after = (v, u) if is_step(here, inverse_depth[i, j]) else (i, j)
                before = (v, u) if is_step(here, inverse_depth[v0, u0]) else (v0, u0)
                along[k] = points[after] - points[before]
            normal = np.cross(along[1], along[0])
            length = np.sqrt((normal**2).sum())
            if here > 0 and length > 0:
                normals[v, u] = normal / length
    return normals


@compiled
def _numbered(points: Array, normals: Array, inverse_depth: Floats) -> NDArray[np.int32]:
    """Breadth first from block to block."""
    height, width = inverse_depth.shape
    numbers = np.zeros((height, width), np.int32)
    queue, last = np.empty((height * width, 2), np.int64), 0
    for first in range(height * width):
        v, u = divmod(first, width)
        if inverse_depth[v, u] == 0 or numbers[v, u] > 0:
            continue
        last += 1
        numbers[v, u] = last
        queue[0, 0], queue[0, 1] = v, u
        begin, end = 0, 1
        while begin < end:
            v, u = queue[begin]
            begin += 1
            for dv, du in ((0, 1), (1, 0), (0, -1), (-1, 0)):
                i, j = v + dv, u + du
                if not (0 <= i < height and 0 <= j < width) or numbers[i, j] > 0:
                    continue
                if not is_step(inverse_depth[v, u], inverse_depth[i, j]) and not _is_edge(
                    points, normals, (v, u), (i, j)
                ):
                    numbers[i, j] = last
                    queue[end, 0], queue[end, 1] = i, j
                    end += 1
    return numbers


@compiled
def _is_edge(points: Array, normals: Array, a: tuple[int, int], b: tuple[int, int]) -> bool:
    """Whether the surface bends inwards between two neighbours, by the blocks beyond either."""
    v, u = _beyond(normals, a, b)
    i, j = _beyond(normals, b, a)
    first, second = normals[v, u], normals[i, j]
    if not (first.any() and second.any()):
        return True
    is_concave = ((second - first) * (points[i, j] - points[v, u])).sum() < 0
    return bool(is_concave and (first * second).sum() < MIN_COSINE)


@compiled
def _beyond(normals: Array, block: tuple[int, int], other: tuple[int, int]) -> tuple[int, int]:
    """The neighbour on the far side of a block, or the block where that has no normal."""
    height, width = normals.shape[:2]
    v, u = 2 * block[0] - other[0], 2 * block[1] - other[1]
    if 0 <= v < height and 0 <= u < width and normals[v, u].any():
        return v, u
    return block
