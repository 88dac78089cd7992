"""Named places drawn on a map from above: goals, floor to keep out of, one-ways with arrows."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon

from vnav.core.arrays import Array
from vnav.core.places import NamedPlace, OneWay, Zones

BARRED: dict[str, Any] = {"facecolor": "#ffcdd2", "edgecolor": "#b71c1c", "hatch": "//"}
LED: dict[str, Any] = {"facecolor": "#fff59d80", "edgecolor": "#e65100"}
GOAL = "#6a1b9a"
ARROWS = 4  # across the longer side of a one-way
ARROW_M = 0.8  # the longest


def draw_zones(axes: Axes, zones: Zones) -> list[Artist]:
    """Polygons with their names; their entries of the legend."""
    entries = list[Artist]()
    for name, corners in zones.keep_out.items():
        axes.add_patch(Polygon(corners, **BARRED))
        _write(axes, name, corners.mean(0), BARRED["edgecolor"])
    if zones.keep_out:
        entries.append(Patch(**BARRED, label="to keep out of"))
    for name, one_way in zones.one_way.items():
        axes.add_patch(Polygon(one_way.corners_m, **LED))
        _draw_arrows(axes, one_way)
        _write(axes, name, one_way.corners_m.mean(0), LED["edgecolor"])
    if zones.one_way:
        entries.append(Patch(**LED, label="one way, as the arrows"))
    return entries


def draw_goals(axes: Axes, goals: Mapping[str, NamedPlace]) -> list[Artist]:
    """Goals with their names; their entry of the legend."""
    for name, goal in goals.items():
        x, y = goal.points_m[0]
        axes.plot(x, y, "*", color=GOAL, ms=9, zorder=5)
        _write(axes, name, goal.points_m[0], GOAL, above=True)
    return [Line2D([], [], color=GOAL, ls="", marker="*", label="goal")] if goals else []


def _draw_arrows(axes: Axes, one_way: OneWay) -> None:
    """Arrows inside the polygon, evenly over it; one at least."""
    corners, ahead = one_way.corners_m, one_way.ahead
    low, high = corners.min(0), corners.max(0)
    step_m = float((high - low).max()) / ARROWS
    length_m = min(0.8 * step_m, ARROW_M)
    counts = np.maximum(1, np.rint((high - low) / step_m)).astype(int)
    sides = [(np.arange(n) + 0.5) / n for n in counts]
    middles = low + np.stack(np.meshgrid(*sides), -1).reshape(-1, 2) * (high - low)
    shape = Polygon(corners).get_path()
    inside = middles[shape.contains_points(middles)]
    for middle in inside if len(inside) else corners.mean(0)[None]:
        _draw_arrow(axes, middle - ahead * length_m / 2, middle + ahead * length_m / 2)


def _draw_arrow(axes: Axes, tail: Array, tip: Array) -> None:
    style = {"arrowstyle": "-|>", "color": LED["edgecolor"], "lw": 1.2, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", tuple(tip), tuple(tail), arrowprops=style, zorder=2, annotation_clip=True)


def _write(axes: Axes, name: str, at: Array, color: str, *, above: bool = False) -> None:
    """A name, readable on whatever is under it."""
    label = axes.annotate(
        name,
        tuple(at),
        xytext=(0, 8 if above else 0),
        textcoords="offset points",
        color=color,
        ha="center",
        va="center",
        bbox={"facecolor": "white", "alpha": 0.75, "lw": 0, "pad": 1},
        zorder=3,
        annotation_clip=True,
    )
    label.set_parse_math(False)  # a name may have a dollar sign
