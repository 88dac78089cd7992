"""A robot that is no disc: its outline, and whether that hits something.

All is told in cells: points are column and row, as for `smoothing.smooth`. An occupied cell is a
disc that holds it, as for a round robot.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Array

STEP_M = 0.002  # the farthest that a point of the robot moves between two poses that are checked
STEPS = 250  # of a robot that is larger than so many of them, the step is such a part of its radius


@dataclass(frozen=True)
class Footprint:
    """A polygon (N, 2) in cells about the point that follows the path, x forward.

    ``margin``: how far its edge stays off the centre of an occupied cell; ``step``: the farthest
    that a point of it moves between two poses that are checked.
    """

    corners: Array
    margin: float
    step: float

    @property
    def inscribed(self) -> float:
        """Radius of the largest disc about the origin that it holds."""
        a, b = np.roll(self.corners, 1, 0), self.corners
        part = np.clip((-a * (b - a)).sum(1) / ((b - a) ** 2).sum(1), 0, 1)
        return float(np.hypot(*(a + part[:, None] * (b - a)).T).min())

    @property
    def circumscribed(self) -> float:
        """Radius of the smallest disc about the origin that holds it."""
        return float(np.hypot(*self.corners.T).max())

    def driving(self, a: Array, b: Array) -> Array:
        """Poses (S, 3) from one point to another, with the yaw of that way."""
        way = b - a
        parts = np.linspace(0, 1, 2 + int(np.hypot(*way) / self.step))
        return np.column_stack(
            [a + parts[:, None] * way, np.full(len(parts), np.arctan2(*way[::-1]))]
        )

    def turning(self, at: Array, before_rad: float, after_rad: float) -> Array:
        """Poses (S, 3) of the shorter turn on the spot; of half a turn, those of both ways."""
        angle = (after_rad - before_rad + np.pi) % (2 * np.pi) - np.pi
        sweeps = (angle, -angle) if abs(angle) > np.pi - 1e-6 else (angle,)
        count = 2 + int(abs(angle) * self.circumscribed / self.step)
        yaw = np.concatenate([before_rad + np.linspace(0, sweep, count) for sweep in sweeps])
        return np.column_stack([np.tile(at, (len(yaw), 1)), yaw])

    def following(self, path: Array, first_rad: float | None, last_rad: float | None) -> Array:
        """Poses (S, 3) along a path (K, 2): straight on, and turns on the spot at its corners.

        ``first_rad`` and ``last_rad``: the yaw before it and after it, where they are given.
        """
        path = path[np.append(True, (np.diff(path, axis=0) != 0).any(1))]
        yaw = [float(np.arctan2(y, x)) for x, y in np.diff(path, axis=0)]
        after = [*yaw, last_rad if last_rad is not None else yaw[-1] if yaw else first_rad or 0.0]
        before = [after[0] if first_rad is None else first_rad, *yaw]
        parts = [self.turning(path[0], before[0], after[0])]
        for k in range(len(yaw)):
            parts.append(self.driving(path[k], path[k + 1]))
            parts.append(self.turning(path[k + 1], before[k + 1], after[k + 1]))
        return np.concatenate(parts)

    def first_hit(self, occupied: NDArray[np.bool_], poses: Array) -> int:
        """The first of the poses (S, 3) that is too near an occupied cell, -1 where none is."""
        return int(_first_hit(occupied, self.corners, poses, self.circumscribed, self._off))

    @property
    def _off(self) -> float:
        """The margin of poses that are checked, with which none between them has less."""
        return self.margin + self.step / 2

    def hits(
        self, occupied: NDArray[np.bool_], asked: NDArray[np.bool_], poses: Array
    ) -> NDArray[np.bool_]:
        """At which of the cells (rows, columns) asked one of the poses (S, 3) hits something.

        Poses are counted from the cell's centre.
        """
        reach = int(self.circumscribed + self._off + np.hypot(*poses[-1, :2])) + 1
        stencil = _stencil(self.corners, poses, reach, self.circumscribed, self._off)
        return _hit(occupied, asked, np.argwhere(stencil) - reach)

    @property
    def reach(self) -> float:
        """An occupied cell that is farther from its origin never matters to it."""
        return self.circumscribed + self._off


@compiled
def _away(corners: Array, x: float, y: float) -> float:
    """Distance of a point from a polygon, 0 inside."""
    is_inside, least = False, np.inf
    for k in range(len(corners)):
        ax, ay = corners[k - 1]
        bx, by = corners[k]
        if (ay > y) != (by > y) and x < ax + (y - ay) * (bx - ax) / (by - ay):
            is_inside = not is_inside
        length = (bx - ax) ** 2 + (by - ay) ** 2
        part = ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / length if length > 0 else 0.0
        part = min(max(part, 0.0), 1.0)
        least = min(least, np.hypot(ax + part * (bx - ax) - x, ay + part * (by - ay) - y))
    return 0.0 if is_inside else least


@compiled
def _first_hit(
    occupied: NDArray[np.bool_], corners: Array, poses: Array, radius: float, margin: float
) -> int:
    reach, (rows, columns) = radius + margin, occupied.shape
    for k in range(len(poses)):
        x, y, cos, sin = poses[k, 0], poses[k, 1], np.cos(poses[k, 2]), np.sin(poses[k, 2])
        for r in range(max(0, int(y - reach) - 1), min(rows, int(y + reach) + 1)):
            for c in range(max(0, int(x - reach) - 1), min(columns, int(x + reach) + 1)):
                dx, dy = c + 0.5 - x, r + 0.5 - y
                if not occupied[r, c] or dx * dx + dy * dy >= reach * reach:
                    continue
                if _away(corners, cos * dx + sin * dy, cos * dy - sin * dx) < margin:
                    return k
    return -1


@compiled
def _stencil(
    corners: Array, poses: Array, reach: int, radius: float, margin: float
) -> NDArray[np.bool_]:
    """Which cells (2 reach + 1, 2 reach + 1) about that at the origin one of the poses hits."""
    size, farthest = 2 * reach + 1, (radius + margin) ** 2
    hit = np.zeros((size, size), np.bool_)
    for k in range(len(poses)):
        cos, sin = np.cos(poses[k, 2]), np.sin(poses[k, 2])
        for r in range(size):
            for c in range(size):
                dx, dy = c - reach - poses[k, 0], r - reach - poses[k, 1]
                if not hit[r, c] and dx * dx + dy * dy < farthest:
                    hit[r, c] = _away(corners, cos * dx + sin * dy, cos * dy - sin * dx) < margin
    return hit


@compiled
def _hit(
    occupied: NDArray[np.bool_], asked: NDArray[np.bool_], offsets: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Which of the cells asked have an occupied one at one of some offsets (M, 2)."""
    (rows, columns), hit = occupied.shape, np.zeros(occupied.shape, np.bool_)
    for r in range(rows):
        for c in range(columns):
            if not asked[r, c]:
                continue
            for k in range(len(offsets)):
                i, j = r + offsets[k, 0], c + offsets[k, 1]
                if 0 <= i < rows and 0 <= j < columns and occupied[i, j]:
                    hit[r, c] = True
                    break
    return hit
