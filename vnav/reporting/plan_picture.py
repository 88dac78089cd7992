"""A picture of a planned path, from above."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon

from vnav.config.outline import corners_of
from vnav.core.arrays import Array
from vnav.core.frame import Rejected
from vnav.core.grid import OCCUPIED, UNKNOWN, WALKED
from vnav.planning.narrowest import NarrowPlace
from vnav.reporting.figures import COLORS, extent_of, grid_image, legend, map_figure, save
from vnav.reporting.zone_picture import draw_zones
from vnav.stages.plan import FloorPose, PlanAnswer

INFLATED, PATH = (1.0, 0.88, 0.80), "#1565c0"
Look = tuple[str, str, str, float]  # name, colour, marker, its size in points
START: Look = ("start", "#2e7d32", "o", 12)
GOAL: Look = ("goal", "#c62828", "s", 6)  # it shows on the start where both are at one place
VIA: Look = ("via", "#6a1b9a", "D", 9)
NARROW, OUTLINE = "#d500f9", "#455a64"
ARROW_M = 0.5
OUTLINES_M = 1.0  # along the path, from one to the next


def write_picture(path: Path, answer: PlanAnswer) -> None:
    """Write a PNG of the path on the grid, or of start and goal where there is no path."""
    save(plan_figure(answer), path, "--png", format="png", bbox_inches="tight")


def plan_figure(answer: PlanAnswer) -> Figure:
    """The grid with its inflated obstacles, the path, and start and goal with their headings.

    Floor to keep out of is hatched, one-ways have arrows. A place that was moved is drawn hollow
    where it was asked for. Where there is no path, the place that is too narrow is marked.
    """
    found, costs = answer.found, answer.costs
    figure, axes = map_figure(extent_of(costs.grid), "Path" if found else "No path")
    entries = [*_draw_grid(axes, answer), *draw_zones(axes, costs.zones)]
    if found:
        axes.plot(*found.poses[:, :2].T, color=PATH, lw=2, solid_capstyle="round")
        entries.append(Line2D([], [], color=PATH, lw=2, label=f"path, {found.length_m:.2f} m"))
        entries += _draw_footprints(axes, costs.config.footprint, found.poses)
    if answer.narrowest is not None:
        entries += _draw_narrowest(axes, answer.narrowest)
    start, goal = answer.places
    for look, places in ((START, (start,)), (GOAL, (goal,)), (VIA, answer.via)):
        entries += _draw_places(axes, look, places, filled=bool(found))
    if found:
        first, last = found.poses[[0, -1]]
        faces = start.yaw_rad if isinstance(start, FloorPose) else None
        _draw_end(axes, START, first if faces is None else np.append(first[:2], faces))
        _draw_end(axes, GOAL, last)
        for over in found.via:
            axes.plot(*over.snapped, VIA[2], color=VIA[1], ms=VIA[3], zorder=5)
        if any(end.moved_m for end in (found.start, found.goal, *found.via)):
            moved = Line2D([], [], color=OUTLINE, ls="", marker=GOAL[2], mfc="none")
            moved.set_label("as asked, then moved")
            entries.append(moved)
    legend(figure, entries)
    return figure


def _draw_grid(axes: Axes, answer: PlanAnswer) -> list[Artist]:
    """What the path is planned on; its entries of the legend."""
    costs = answer.costs
    seen, planned_on = costs.seen.cells, costs.grid.cells
    is_kept_out = (planned_on == OCCUPIED) & (seen != OCCUPIED)
    image = grid_image(replace(costs.grid, cells=np.where(is_kept_out, seen, planned_on)))
    inflated = costs.inflated & (planned_on != OCCUPIED)
    image[inflated] = image[inflated] * INFLATED
    axes.imshow(image, origin="lower", extent=extent_of(costs.grid), interpolation="nearest")
    entries: list[Artist] = [
        Patch(facecolor=COLORS[OCCUPIED], label="occupied"),
        Patch(facecolor=COLORS[UNKNOWN], label="unknown"),
        Patch(facecolor=INFLATED, edgecolor="#90a4ae", label="too near an obstacle"),
    ]
    if (costs.grid.cells == WALKED).any():
        entries.insert(2, Patch(facecolor=COLORS[WALKED], label="walked, not seen"))
    return entries


def _draw_footprints(axes: Axes, footprint: str, poses: Array) -> list[Artist]:
    """The robot's outline along the path, at its corners and every metre."""
    if not footprint:
        return []
    corners = np.array(corners_of(footprint))
    gone_m = np.append(0, np.hypot(*np.diff(poses[:, :2], axis=0).T).cumsum())
    shown = np.unique(
        [0, *np.searchsorted(gone_m, np.arange(0, gone_m[-1], OUTLINES_M)), len(poses) - 1]
    )
    for x, y, yaw in poses[shown]:
        R = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        axes.add_patch(Polygon(corners @ R.T + (x, y), fill=False, ec=OUTLINE, lw=0.8, zorder=3))
    return [Patch(fill=False, edgecolor=OUTLINE, label="footprint")]


def _draw_narrowest(axes: Axes, place: NarrowPlace) -> list[Artist]:
    """What is too narrow: from one side to the other, with a ring about it."""
    ends = place.sides if len(place.sides) == 2 else np.vstack([place.sides, place.at])
    axes.plot(*ends.T, color=NARROW, lw=2.5, zorder=6, solid_capstyle="butt")
    axes.plot(*ends.mean(0), "o", color=NARROW, ms=18, mfc="none", mew=1.5, zorder=6)
    label = f"narrowest place, {place.width_text}"
    return [Line2D([], [], color=NARROW, ls="", marker="o", mfc="none", label=label)]


def _draw_places(
    axes: Axes, look: Look, places: Sequence[FloorPose | Rejected], *, filled: bool
) -> list[Artist]:
    """Places that were asked for, hollow, as far as they are known; ``filled``: in the legend."""
    name, color, marker, size = look
    known = [place for place in places if isinstance(place, FloorPose)]
    for place in known:
        axes.plot(*place.point, marker, color=color, ms=size + 1, mfc="none", mew=1.5, zorder=4)
    face = color if filled else "none"
    entry = Line2D([], [], color=color, ls="", marker=marker, ms=size, mfc=face, label=name)
    return [entry] if known else []


def _draw_end(axes: Axes, look: Look, pose: Array) -> None:
    """A filled marker, and an arrow the way the robot looks."""
    _, color, marker, size = look
    x, y, yaw = pose
    axes.plot(x, y, marker, color=color, ms=size, zorder=5)
    tip = x + ARROW_M * np.cos(yaw), y + ARROW_M * np.sin(yaw)
    style = {"arrowstyle": "-|>", "color": color, "lw": 2, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", tip, (x, y), arrowprops=style, zorder=5)
