"""A picture of a planned path, from above."""

from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from vnav.core.grid import OCCUPIED, UNKNOWN, WALKED
from vnav.errors import VnavError
from vnav.io.files import whole_file
from vnav.planning.costmap import costmap
from vnav.planning.planner import Plan
from vnav.reporting.figures import COLORS, extent_of, grid_image, legend, map_figure
from vnav.stages.plan import FloorPose, PlanAnswer

INFLATED, PATH = (1.0, 0.88, 0.80), "#1565c0"
ENDS = (("start", "#2e7d32", "o"), ("goal", "#c62828", "s"))
ARROW_M = 0.5


def write_picture(path: Path, answer: PlanAnswer) -> None:
    """Write a PNG of the path on the grid, or of start and goal where there is no path."""
    try:
        with whole_file(path) as file:
            plan_figure(answer).savefig(file, format="png", bbox_inches="tight")
    except OSError as error:
        raise VnavError(
            f"expected to write {path}, found: {error.strerror}; name another file with --png"
        ) from error


def plan_figure(answer: PlanAnswer) -> Figure:
    """The grid with its inflated obstacles, the path, and start and goal with their headings.

    A place that was moved is drawn hollow where it was asked for.
    """
    grid, found = answer.grid, answer.plan if isinstance(answer.plan, Plan) else None
    figure, axes = map_figure(extent_of(grid), "Path" if found else "No path")
    costs = costmap(grid, answer.uncertainty_m, answer.config)
    inflated = costs.inflated & (grid.cells != OCCUPIED)
    image = grid_image(costs.grid)
    image[inflated] = image[inflated] * INFLATED
    axes.imshow(image, origin="lower", extent=extent_of(grid), interpolation="nearest")
    entries: list[Artist] = [
        Patch(facecolor=COLORS[OCCUPIED], label="occupied"),
        Patch(facecolor=COLORS[UNKNOWN], label="unknown"),
        Patch(facecolor=INFLATED, edgecolor="#90a4ae", label="too near an obstacle"),
    ]
    if (costs.grid.cells == WALKED).any():
        entries.insert(2, Patch(facecolor=COLORS[WALKED], label="walked, not seen"))
    if found:
        axes.plot(*found.poses[:, :2].T, color=PATH, lw=2, solid_capstyle="round")
        entries.append(Line2D([], [], color=PATH, lw=2, label=f"path, {found.length_m:.2f} m"))
    for (name, color, marker), place in zip(ENDS, answer.places, strict=True):
        if isinstance(place, FloorPose):
            axes.plot(*place.point, marker, color=color, ms=9, mfc="none", mew=1.5, zorder=4)
            entries.append(Line2D([], [], color=color, ls="", marker=marker, label=name))
    if found:
        _draw_end(axes, found, 0)
        _draw_end(axes, found, -1)
    legend(figure, entries)
    return figure


def _draw_end(axes: Axes, plan: Plan, index: int) -> None:
    """A filled marker, and an arrow the way the robot looks."""
    _, color, marker = ENDS[index]
    x, y, yaw = plan.poses[index]
    axes.plot(x, y, marker, color=color, ms=8, zorder=5)
    tip = x + ARROW_M * np.cos(yaw), y + ARROW_M * np.sin(yaw)
    style = {"arrowstyle": "-|>", "color": color, "lw": 2, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", tip, (x, y), arrowprops=style, zorder=5)
