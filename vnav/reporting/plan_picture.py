"""A picture of a planned path, from above."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon

from vnav.core.arrays import Array
from vnav.core.frame import Rejected
from vnav.core.grid import OCCUPIED, UNKNOWN, WALKED
from vnav.planning.costmap import costmap
from vnav.reporting.figures import COLORS, extent_of, grid_image, legend, map_figure, save
from vnav.stages.plan import FloorPose, PlanAnswer

INFLATED, PATH = (1.0, 0.88, 0.80), "#1565c0"
START, GOAL, VIA = ("start", "#2e7d32", "o"), ("goal", "#c62828", "s"), ("via", "#6a1b9a", "D")
BARRED = "#ffcdd2", "#b71c1c"  # face and edge
ARROW_M = 0.5


def write_picture(path: Path, answer: PlanAnswer) -> None:
    """Write a PNG of the path on the grid, or of start and goal where there is no path."""
    save(plan_figure(answer), path, "--png", format="png", bbox_inches="tight")


def plan_figure(answer: PlanAnswer) -> Figure:
    """The grid with its inflated obstacles, the path, and start and goal with their headings.

    Floor to keep out of is hatched. A place that was moved is drawn hollow where it was asked for.
    """
    found = answer.found
    figure, axes = map_figure(extent_of(answer.grid), "Path" if found else "No path")
    entries = [*_draw_grid(axes, answer), *_draw_keep_outs(axes, answer)]
    if found:
        axes.plot(*found.poses[:, :2].T, color=PATH, lw=2, solid_capstyle="round")
        entries.append(Line2D([], [], color=PATH, lw=2, label=f"path, {found.length_m:.2f} m"))
    start, goal = answer.places
    for look, places in ((START, (start,)), (GOAL, (goal,)), (VIA, answer.via)):
        entries += _draw_places(axes, look, places)
    if found:
        _draw_end(axes, START, found.poses[0])
        _draw_end(axes, GOAL, found.poses[-1])
    legend(figure, entries)
    return figure


def _draw_grid(axes: Axes, answer: PlanAnswer) -> list[Artist]:
    """What the path is planned on; its entries of the legend."""
    barred = answer.grid.blocked(answer.keep_out.values())
    costs = costmap(barred, answer.uncertainty_m, answer.config)
    inflated = costs.inflated & (barred.cells != OCCUPIED)
    cells = np.where(barred.cells == answer.grid.cells, costs.grid.cells, answer.grid.cells)
    image = grid_image(replace(costs.grid, cells=cells))
    image[inflated] = image[inflated] * INFLATED
    axes.imshow(image, origin="lower", extent=extent_of(answer.grid), interpolation="nearest")
    entries: list[Artist] = [
        Patch(facecolor=COLORS[OCCUPIED], label="occupied"),
        Patch(facecolor=COLORS[UNKNOWN], label="unknown"),
        Patch(facecolor=INFLATED, edgecolor="#90a4ae", label="too near an obstacle"),
    ]
    if (costs.grid.cells == WALKED).any():
        entries.insert(2, Patch(facecolor=COLORS[WALKED], label="walked, not seen"))
    return entries


def _draw_keep_outs(axes: Axes, answer: PlanAnswer) -> list[Artist]:
    """Floor to keep out of, with its names."""
    colors: dict[str, Any] = {"facecolor": BARRED[0], "edgecolor": BARRED[1], "hatch": "//"}
    for name, corners in answer.keep_out.items():
        axes.add_patch(Polygon(corners, **colors))
        x, y = corners.mean(0)
        label = axes.text(x, y, name, color=BARRED[1], ha="center", va="center", clip_on=True)
        label.set_parse_math(False)  # a name may have a dollar sign
    return [Patch(**colors, label="to keep out of")] if answer.keep_out else []


def _draw_places(
    axes: Axes, look: tuple[str, str, str], places: Sequence[FloorPose | Rejected]
) -> list[Artist]:
    """Places that were asked for, hollow, as far as they are known."""
    name, color, marker = look
    known = [place for place in places if isinstance(place, FloorPose)]
    for place in known:
        axes.plot(*place.point, marker, color=color, ms=9, mfc="none", mew=1.5, zorder=4)
    return [Line2D([], [], color=color, ls="", marker=marker, label=name)] if known else []


def _draw_end(axes: Axes, look: tuple[str, str, str], pose: Array) -> None:
    """A filled marker, and an arrow the way the robot looks."""
    _, color, marker = look
    x, y, yaw = pose
    axes.plot(x, y, marker, color=color, ms=8, zorder=5)
    tip = x + ARROW_M * np.cos(yaw), y + ARROW_M * np.sin(yaw)
    style = {"arrowstyle": "-|>", "color": color, "lw": 2, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", tip, (x, y), arrowprops=style, zorder=5)
