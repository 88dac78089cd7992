"""A polygon round the origin, as a setting: a robot seen from above."""

import math
from dataclasses import dataclass
from itertools import combinations
from typing import Any

Corner = tuple[float, float]

MOST_M = 10.0  # from the origin


def corners_of(text: str) -> tuple[Corner, ...]:
    """Corners written "X,Y X,Y X,Y"; ValueError where the text is none such."""
    pairs = [word.split(",") for word in text.split()]
    return tuple((float(x), float(y)) for x, y in pairs)


@dataclass(frozen=True)
class Outline:
    """A text of three corners or more in metres, whose edges go round 0,0 and do not cross."""

    def taken(self, value: Any) -> str | None:
        """The text with single spaces, None where it is not allowed; empty: there is none."""
        if not isinstance(value, str):
            return None
        try:
            corners = corners_of(value)
        except ValueError:
            return None
        return " ".join(value.split()) if not corners or _is_outline(corners) else None

    @property
    def short(self) -> str:
        """For a table."""
        return "corners X,Y X,Y X,Y round 0,0, or empty"

    def __str__(self) -> str:
        return f"three corners X,Y or more round 0,0, within {MOST_M:g} m, no edges crossing"


def _is_outline(corners: tuple[Corner, ...]) -> bool:
    if len(set(corners)) < max(3, len(corners)) or not all(
        abs(c) <= MOST_M for corner in corners for c in corner
    ):
        return False
    edges = list(zip(corners, corners[1:] + corners[:1], strict=True))
    apart = (
        (a, b) for (i, a), (j, b) in combinations(enumerate(edges), 2) if 1 < j - i < len(edges) - 1
    )
    if any(_cross(a, b) for a, b in apart):
        return False
    turns = [_turn(a, b) for a, b in edges]
    on_edge = (0.0, 0.0) in corners or any(abs(turn) == math.pi for turn in turns)
    return not on_edge and abs(sum(turns)) > math.pi


def _turn(a: Corner, b: Corner) -> float:
    """The angle under which the origin sees an edge."""
    return math.atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1])


def _cross(a: tuple[Corner, Corner], b: tuple[Corner, Corner]) -> bool:
    """Whether two edges touch."""
    beside = _side(*a, b[0]) * _side(*a, b[1]) > 0 or _side(*b, a[0]) * _side(*b, a[1]) > 0
    apart = any(
        max(p[k] for p in a) < min(p[k] for p in b) or max(p[k] for p in b) < min(p[k] for p in a)
        for k in (0, 1)
    )
    return not (beside or apart)


def _side(a: Corner, b: Corner, point: Corner) -> float:
    """Above 0 where a point lies left of a line, below where it lies right of it."""
    return (b[0] - a[0]) * (point[1] - a[1]) - (b[1] - a[1]) * (point[0] - a[0])
