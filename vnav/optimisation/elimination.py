"""The loops of normal equations, compiled: products, and landmarks that are eliminated.

The observations of a landmark follow each other in ``across`` and ``camera``; ``ends`` (L,) says
where they end. Of the blocks of a system, `Levels` says where they are.
"""

import numpy as np

from vnav.compiled import compiled
from vnav.core.arrays import Array, Rows


@compiled
def multiply(
    order: Rows,
    camera: Rows,
    landmark: Rows,
    of_camera: Array,
    of_point: Array,
    cameras: Array,
    points: Array,
    across: Array,
) -> None:
    """Fill in the products of the derivatives; those across cameras and landmarks in order."""
    for k in range(len(order)):
        m = order[k]
        A, P, c, n = of_camera[m], of_point[m], camera[m], landmark[m]
        for r in range(6):
            for s in range(6):
                cameras[c, r, s] += A[0, r] * A[0, s] + A[1, r] * A[1, s] + A[2, r] * A[2, s]
            for s in range(3):
                across[k, r, s] = A[0, r] * P[0, s] + A[1, r] * P[1, s] + A[2, r] * P[2, s]
        for r in range(3):
            for s in range(3):
                points[n, r, s] += P[0, r] * P[0, s] + P[1, r] * P[1, s] + P[2, r] * P[2, s]


@compiled
def project(
    camera: Rows,
    landmark: Rows,
    of_camera: Array,
    of_point: Array,
    residuals: Array,
    of_cameras: Array,
    of_points: Array,
) -> None:
    """Add the derivatives times what is observed (M, 3, R)."""
    for m in range(len(camera)):
        for a in range(3):
            for s in range(residuals.shape[2]):
                value = residuals[m, a, s]
                for r in range(6):
                    of_cameras[camera[m], r, s] += of_camera[m, a, r] * value
                for r in range(3):
                    of_points[landmark[m], r, s] += of_point[m, a, r] * value


@compiled
def eliminate(
    values: Array,
    level: Rows,
    place: Rows,
    size: Rows,
    on: Rows,
    beside: Rows,
    camera: Rows,
    ends: Rows,
    across: Array,
    inverse: Array,
) -> None:
    """Take off what landmarks take up, by the cameras (M,) that see them, in their order."""
    first, taken = 0, np.zeros((6, 3))
    for n in range(len(ends)):
        for a in range(first, ends[n]):
            _product(across[a], inverse[n], taken)
            for b in range(first, ends[n]):
                at, stride = _at(level, place, size, on, beside, camera[a], camera[b])
                if at < 0:
                    continue
                B = across[b]
                for r in range(6):
                    for s in range(6):
                        values[at + r * stride + s] -= (
                            taken[r, 0] * B[s, 0] + taken[r, 1] * B[s, 1] + taken[r, 2] * B[s, 2]
                        )
        first = ends[n]


@compiled
def _product(block: Array, square: Array, found: Array) -> None:
    """A block (6, 3) times a square one (3, 3)."""
    for r in range(6):
        for s in range(3):
            found[r, s] = 0.0
            for k in range(3):
                found[r, s] += block[r, k] * square[k, s]


@compiled
def put(
    values: Array,
    level: Rows,
    place: Rows,
    size: Rows,
    on: Rows,
    beside: Rows,
    i: Rows,
    j: Rows,
    blocks: Array,
) -> None:
    """Add blocks (B, 6, 6) of cameras i and j (B,), where the system keeps such."""
    for k in range(len(i)):
        at, stride = _at(level, place, size, on, beside, i[k], j[k])
        if at >= 0:
            for r in range(6):
                for s in range(6):
                    values[at + r * stride + s] += blocks[k, r, s]


@compiled
def _at(
    level: Rows, place: Rows, size: Rows, on: Rows, beside: Rows, i: int, j: int
) -> tuple[int, int]:
    """Where the block of two cameras begins, and its rows' distance; -1 where it is not kept."""
    n = level[i]
    if level[j] == n and place[j] <= place[i]:
        stride = 6 * size[n]
        return on[n] + 6 * (place[i] * stride + place[j]), stride
    if level[j] == n + 1:
        stride = 6 * size[n + 1]
        return beside[n] + 6 * (place[i] * stride + place[j]), stride
    return -1, 0


@compiled
def less_of_points(right: Array, camera: Rows, ends: Rows, across: Array, points: Array) -> None:
    """Take the landmarks' solutions (L, 3, R) off the cameras' right sides."""
    first = 0
    for n in range(len(ends)):
        for k in range(first, ends[n]):
            for r in range(6):
                for s in range(right.shape[2]):
                    for a in range(3):
                        right[camera[k], r, s] -= across[k, r, a] * points[n, a, s]
        first = ends[n]


@compiled
def less_of_cameras(right: Array, camera: Rows, ends: Rows, across: Array, tangents: Array) -> None:
    """Take the cameras' solutions (K, 6, R) off the landmarks' right sides."""
    first = 0
    for n in range(len(ends)):
        for k in range(first, ends[n]):
            for a in range(3):
                for s in range(right.shape[2]):
                    for r in range(6):
                        right[n, a, s] -= across[k, r, a] * tangents[camera[k], r, s]
        first = ends[n]
