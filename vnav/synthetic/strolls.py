"""A walker's way over time: knots every half second, and the posture between them.

Position, heading and sitting down are quadratic B-splines over the knots: a walker never moves
faster than along the fastest step, starts and stops softly, and is still where four knots agree.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vnav.synthetic.figure import Posture

STEP_S = 0.5
FULL_SWING_M_S = 0.7  # arms and legs swing less below
WALK, STAND, SIT = range(3)  # what is done between two knots
SEATED = 0.0, 0.5, 1.0  # how far, from the second knot of a pause on, and back at its end


@dataclass(frozen=True)
class Stroll:
    """Where a walker is from time 0 on; ``knots`` (K, 4): x, y in metres, yaw not wrapped, sit."""

    knots: NDArray[np.float64]

    def at(self, t_s: float) -> Posture:
        """The posture at a time; the ends are kept beyond them."""
        x, y, yaw, sit = spline(self.knots, t_s).tolist()
        vx, vy = (spline(self.knots[:, :2], t_s, 1)).tolist()
        swing = min(1.0, float(np.hypot(vx, vy)) / FULL_SWING_M_S)
        return Posture(x, y, yaw, float(np.interp(t_s, *self._walked)), swing, sit)

    def moves_at(self, t_s: float) -> bool:
        """Whether any of the body moves."""
        return bool(np.abs(spline(self.knots, t_s, 1)).max() > 1e-6)

    @cached_property
    def _walked(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Times, and metres walked until then."""
        times = np.arange(0, len(self.knots) * STEP_S, STEP_S / 10)
        xy = np.array([spline(self.knots[:, :2], t) for t in times])
        return times, np.append(0, np.cumsum(np.hypot(*np.diff(xy, axis=0).T)))


def spline(knots: NDArray[np.float64], t_s: float, derivative: int = 0) -> NDArray[np.float64]:
    """Value, or velocity per second, of the uniform quadratic B-spline over knots (K, D)."""
    u = min(max(t_s / STEP_S, 0.0), len(knots) - 1.0)
    middle = int(np.floor(u + 0.5))
    f = u - middle
    near = knots[np.clip([middle - 1, middle, middle + 1], 0, len(knots) - 1)]
    if derivative:
        return np.asarray(np.array([f - 0.5, -2 * f, f + 0.5]) @ near / STEP_S)
    return np.asarray(np.array([(0.5 - f) ** 2 / 2, 0.75 - f * f, (0.5 + f) ** 2 / 2]) @ near)


def schedule(intervals: int, sits: bool, rng: np.random.Generator) -> list[int]:
    """What is done in each interval: walks of 4 to 7 s, between them pauses of one kind."""
    kinds: list[int] = []
    while len(kinds) < intervals:
        kinds += [WALK] * int(rng.integers(8, 15))
        kinds += [SIT] * int(rng.integers(8, 12)) if sits else [STAND] * int(rng.integers(5, 7))
    return kinds[:intervals]


def pauses(kinds: list[int]) -> list[tuple[int, int, int]]:
    """First and last knot of every pause, and its kind."""
    edges = [k for k in range(1, len(kinds)) if kinds[k] != kinds[k - 1]]
    parts = zip([0, *edges], [*edges, len(kinds)], strict=True)
    return [(start, end, kinds[start]) for start, end in parts if kinds[start] != WALK]


def stroll(places: NDArray[np.float64], kinds: list[int], seats: NDArray[np.float64]) -> Stroll:
    """The way through places (K, 2), K - 1 intervals of what is done.

    ``seats`` (K, 3): x, y and yaw of the feet of who sits at that place, used at those knots only.
    """
    xy, ahead = places.copy(), np.empty((len(places), 2))
    ahead[1:-1] = places[2:] - places[:-2]
    ahead[0], ahead[-1] = places[1] - places[0], places[-1] - places[-2]
    yaw, sit = np.arctan2(ahead[:, 1], ahead[:, 0]), np.zeros(len(places))
    for start, end, kind in pauses(kinds):
        yaw[start : end + 1] = yaw[max(start - 1, 0)]
        if kind == SIT:
            inside = slice(start + 1, end)
            xy[inside], yaw[inside] = seats[inside, :2], seats[inside, 2]
            yaw[end] = seats[start, 2]
            sit[inside] = _seated(end - start - 1)
    return Stroll(np.column_stack([xy, np.unwrap(yaw), sit]))


def _seated(knots: int) -> NDArray[np.float64]:
    """How far somebody sits at the inner knots of a pause, which a capture's end may cut."""
    down = np.interp(np.arange(knots), np.arange(len(SEATED)), SEATED)
    return np.minimum(down, np.interp(np.arange(knots)[::-1], np.arange(len(SEATED)), (0.5, 1, 1)))
