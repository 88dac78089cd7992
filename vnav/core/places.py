"""Places of a map that have a name, each tied to a frame.

They are goals, floor to keep out of, and floor that is crossed one way only.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from vnav.core import se3
from vnav.core.arrays import Array, frozen

GOAL, KEEP_OUT, ONE_WAY = "goal", "keep-out", "one-way"


def point_of(text: str) -> tuple[float, float] | None:
    """Two finite numbers with a comma between them, else None."""
    try:
        x, y = (float(word) for word in text.split(","))
    except ValueError:
        return None
    return (x, y) if np.isfinite([x, y]).all() else None


@dataclass(frozen=True)
class Anchor:
    """The frame that a place is tied to: which it is, and its pose when the place was named.

    ``capture``: fingerprint; ``frame``: index in it; ``T_world_camera`` (4, 4).
    """

    capture: str
    frame: int
    T_world_camera: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_world_camera", frozen(self.T_world_camera, float, (4, 4)))


@dataclass(frozen=True)
class NamedPlace:
    """A goal, one point, or the corners of a polygon of floor.

    ``points_m`` (N, 2) x and y in the world as it was when ``anchor`` was entered; ``yaw_rad``: how
    a robot stands at a goal, None where that is open; the way that a one-way leads.
    """

    kind: str
    points_m: Array
    yaw_rad: float | None
    anchor: Anchor

    def __post_init__(self) -> None:
        object.__setattr__(self, "points_m", frozen(self.points_m, float, (None, 2)))

    def moved(self, T_world_camera: Array) -> "NamedPlace":
        """The place as it lies now that its frame has another pose; exactly as it was for none."""
        before = self.anchor.T_world_camera
        if np.array_equal(before, T_world_camera):
            return self
        T_now_before = T_world_camera @ se3.inverse(before)
        on_floor = np.column_stack([self.points_m, np.zeros(len(self.points_m))])
        yaw_rad = self.yaw_rad
        if yaw_rad is not None:
            ahead = T_now_before[:2, :2] @ [np.cos(yaw_rad), np.sin(yaw_rad)]
            yaw_rad = float(np.arctan2(ahead[1], ahead[0]))
        return replace(
            self,
            points_m=se3.transform(T_now_before, on_floor)[:, :2],
            yaw_rad=yaw_rad,
            anchor=replace(self.anchor, T_world_camera=T_world_camera),
        )


@dataclass(frozen=True)
class OneWay:
    """A polygon (N, 2), and the heading that nothing in it moves against."""

    corners_m: Array
    heading_rad: float

    @property
    def ahead(self) -> Array:
        """The heading as a unit vector (2,)."""
        return np.array([np.cos(self.heading_rad), np.sin(self.heading_rad)])


@dataclass(frozen=True)
class Zones:
    """Floor that is not free to all, by name: polygons (N, 2) to keep out of, and one-ways."""

    keep_out: Mapping[str, Array] = field(default_factory=dict)
    one_way: Mapping[str, OneWay] = field(default_factory=dict)

    def kinds(self) -> dict[str, str]:
        """What each name is."""
        return {**dict.fromkeys(self.keep_out, KEEP_OUT), **dict.fromkeys(self.one_way, ONE_WAY)}

    def without(self, names: Collection[str]) -> "Zones":
        """The others."""
        return Zones(
            {name: each for name, each in self.keep_out.items() if name not in names},
            {name: each for name, each in self.one_way.items() if name not in names},
        )


def zones_of(places: Mapping[str, NamedPlace]) -> Zones:
    """Those of the places that are floor."""
    keep_out = {name: each.points_m for name, each in places.items() if each.kind == KEEP_OUT}
    one_way = {
        name: OneWay(each.points_m, each.yaw_rad or 0.0)
        for name, each in places.items()
        if each.kind == ONE_WAY
    }
    return Zones(keep_out, one_way)


@dataclass(frozen=True)
class LostPlace:
    """A named place that lies nowhere in the map as it is now, and why."""

    kind: str
    reason: str
