"""Pictures of a map from above, in its reports/: trajectory, grid and cloud."""

from collections.abc import Mapping
from io import BytesIO
from types import MappingProxyType
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from vnav.core.arrays import Array
from vnav.core.grid import STATES, UNKNOWN, Grid
from vnav.core.mapping import FrameTable, LoopVerdict, Odometry
from vnav.core.places import GOAL, LostPlace, NamedPlace, zones_of
from vnav.core.point_cloud import PointCloud
from vnav.io.files import write_bytes
from vnav.io.store.artifacts import load_cloud, load_grid, load_loops, load_odometry, load_optimised
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.places_file import load_places
from vnav.reporting.figures import COLORS, extent_of, grid_image, legend, map_figure
from vnav.reporting.moving_picture import moving_figure
from vnav.reporting.zone_picture import draw_goals, draw_zones
from vnav.volumes.top_view import seen_from_above

NOWHERE: Mapping[str, NamedPlace | LostPlace] = MappingProxyType({})
FADED = 0.35  # the grid under the trajectory
MARGIN_M = 0.3  # about the path
CUT_M = 2.0  # the cloud is drawn up to this height: ceilings would hide the rooms
START: dict[str, Any] = {"marker": "o", "ms": 12, "mfc": "none", "mew": 2.5, "zorder": 5}
END: dict[str, Any] = {"marker": "s", "ms": 5, "zorder": 6}  # it shows in the ring of the start
NOT_FOLLOWED = "#e53935"
PIXEL_M = 0.02  # of the cloud's picture
LONGEST_PX = 1500  # its longest side; larger maps get larger pixels


def draw(folder: MapFolder) -> dict[str, bytes]:
    """Write all pictures of a map whose stages up to fuse are finished; returns them, too."""
    pictures, reports = drawn(folder), folder.root / "reports"
    reports.mkdir(exist_ok=True)
    (reports / "moving.png").unlink(missing_ok=True)
    for name, data in pictures.items():
        write_bytes(reports / f"{name}.png", data)
    return pictures


def drawn(folder: MapFolder) -> dict[str, bytes]:
    """All pictures of such a map, as PNG; what moves is drawn where something does."""
    grid = load_grid(folder)
    odometry, poses = load_odometry(folder), load_optimised(folder).T_world_camera
    figures = {
        "trajectory": trajectory_figure(grid, odometry, poses, load_loops(folder)),
        "grid": grid_figure(grid, load_places(folder)),
        "cloud": cloud_figure(load_cloud(folder)),
        "moving": moving_figure(folder, odometry),
    }
    return {name: _png(figure) for name, figure in figures.items() if figure is not None}


def _png(figure: Figure) -> bytes:
    file = BytesIO()
    figure.savefig(file, bbox_inches="tight")
    return file.getvalue()


def trajectory_figure(
    grid: Grid, odometry: Odometry, T_world_camera: Array, loops: tuple[LoopVerdict, ...]
) -> Figure:
    """The camera's path on the faded grid: accepted loops, and gaps where it was not followed."""
    path = T_world_camera[:, :2, 3]
    left, right, bottom, top = extent_of(grid)
    (x_min, y_min), (x_max, y_max) = np.nanmin(path, 0) - MARGIN_M, np.nanmax(path, 0) + MARGIN_M
    shown = min(left, x_min), max(right, x_max), min(bottom, y_min), max(top, y_max)
    figure, axes = map_figure(shown, "Trajectory")
    axes.set_facecolor(to_rgba(COLORS[UNKNOWN], FADED))
    axes.imshow(grid_image(grid), origin="lower", extent=extent_of(grid), alpha=FADED)
    axes.set(xlim=shown[:2], ylim=shown[2:])
    frames = odometry.frames
    for of_capture in frames.of_captures():
        _draw_path(axes, path, frames, of_capture)
    rows = [keyframe.row for keyframe in odometry.keyframes]
    closed = [(rows[v.i], rows[v.j]) for v in loops if v.accepted and v.is_loop]
    ends = np.array(closed, int).reshape(-1, 2)
    axes.add_collection(LineCollection(list(path[ends]), colors="#8e24aa", lw=0.5, alpha=0.3))
    axes.plot(*path[rows].T, ".", color="#0d47a1", ms=3)
    entries = [
        Line2D([], [], color="#1e88e5", lw=2, label="camera, frame by frame"),
        Line2D([], [], color="#0d47a1", ls="", marker=".", label=f"keyframes ({len(rows)})"),
        Line2D([], [], color="#8e24aa", lw=1, label=f"accepted loops ({len(ends)})"),
        Line2D([], [], color="#2e7d32", ls="", **START, label="start"),
        Line2D([], [], color="#e65100", ls="", **END, label="end"),
    ]
    missing = int((~np.isfinite(path[:, 0])).sum())
    interruptions = sum(int(frames.interrupted(r).sum()) for r in frames.of_captures())
    legend(figure, [*entries, *_not_followed(missing, interruptions)])
    return figure


def grid_figure(grid: Grid, places: Mapping[str, NamedPlace | LostPlace] = NOWHERE) -> Figure:
    """The grid, with the area of each state, and the places with a name that lie on it."""
    figure, axes = map_figure(extent_of(grid), "Grid")
    axes.imshow(grid_image(grid), origin="lower", extent=extent_of(grid), interpolation="nearest")
    entries: list[Artist] = [
        Patch(
            facecolor=COLORS[state],
            edgecolor="#90a4ae",
            label=f"{name}, {grid.area_m2(state):.1f} m²",
        )
        for name, state in STATES.items()
    ]
    placed = {name: place for name, place in places.items() if isinstance(place, NamedPlace)}
    goals = {name: place for name, place in placed.items() if place.kind == GOAL}
    legend(figure, [*entries, *draw_zones(axes, zones_of(placed)), *draw_goals(axes, goals)])
    return figure


def cloud_figure(cloud: PointCloud) -> Figure:
    """The cloud seen from above, shaded by height; empty axes where nothing is low enough."""
    low = cloud.points_world[:, 2] < CUT_M
    shown = PointCloud(cloud.points_world[low], cloud.colors[low])
    title = f"Cloud, up to {CUT_M:g} m above the floor"
    if not len(shown):
        return map_figure((0, 1, 0, 1), title)[0]
    corner = shown.points_world[:, :2].min(0)
    size_m = shown.points_world[:, :2].max(0) - corner
    pixel_m = max(PIXEL_M, float(size_m.max()) / LONGEST_PX)
    image = seen_from_above(shown, pixel_m)
    x, y = (float(c) for c in corner)
    extent = (x, x + image.shape[1] * pixel_m, y, y + image.shape[0] * pixel_m)
    figure, axes = map_figure(extent, title)
    axes.imshow(image, origin="lower", extent=extent)
    return figure


def _draw_path(axes: Axes, path_xy: Array, frames: FrameTable, rows: NDArray[np.intp]) -> None:
    """One capture's path, frames ``rows`` of all (N, 2), in pieces that dotted lines join.

    NaN where a frame has no pose.
    """
    known = rows[np.isfinite(path_xy[rows, 0])]
    apart = (np.diff(known) > 1) | frames.interrupted(known)
    for piece in np.split(known, np.flatnonzero(apart) + 1):
        axes.plot(*path_xy[piece].T, color="#1e88e5", lw=1.8, solid_capstyle="round")
    for ends in zip(known[:-1][apart], known[1:][apart], strict=True):
        axes.plot(*path_xy[[*ends]].T, color=NOT_FOLLOWED, lw=1.8, ls=":")
    if len(known):
        axes.plot(*path_xy[known[0]], color="#2e7d32", **START)
        axes.plot(*path_xy[known[-1]], color="#e65100", **END)


def _not_followed(missing: int, interruptions: int) -> list[Line2D]:
    """What dotted lines stand for, where there are some."""
    counted = {"frames without a pose": missing, "interruptions": interruptions}
    label = ", ".join(f"{name} ({count})" for name, count in counted.items() if count)
    return [Line2D([], [], color=NOT_FOLLOWED, lw=2, ls=":", label=label)] if label else []
