"""Pictures of a map from above, in its reports/: trajectory, grid and cloud."""

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar
from numpy.typing import NDArray

from vnav.core.cloud import PointCloud
from vnav.core.grid import FREE, OCCUPIED, UNKNOWN, Grid
from vnav.core.mapping import LoopVerdict, Odometry
from vnav.io.artifacts import load_loops, load_odometry, load_optimised
from vnav.io.grid_files import read_grid
from vnav.io.map_folder import MapFolder
from vnav.io.ply import read_cloud

NAMES = ("trajectory", "grid", "cloud")
CUT_M = 2.0  # the cloud is drawn up to this height: ceilings would hide the rooms
PIXEL_M = 0.02  # of the cloud's picture
LONGEST_PX = 2000  # its longest side; larger maps get larger pixels
SHADE_PER_M = 3.5  # how much darker a pixel is, by the mean rise to its neighbours
FILLED_BY = 4  # an empty pixel with so many full neighbours takes their mean
BACKGROUND = (0.13, 0.15, 0.17)
COLORS = {FREE: (255, 255, 255), OCCUPIED: (38, 50, 56), UNKNOWN: (214, 218, 222)}
Array = NDArray[np.float64]


def draw(folder: MapFolder) -> tuple[Path, ...]:
    """Draw all pictures of a map whose stages up to fuse are finished; returns the files."""
    grid = read_grid(folder.stage("fuse") / "grid.yaml")
    odometry, poses = load_odometry(folder), load_optimised(folder).T_world_camera
    figures = (
        trajectory_figure(grid, odometry, poses, load_loops(folder)),
        grid_figure(grid),
        cloud_figure(read_cloud(folder.stage("fuse") / "cloud.ply")),
    )
    paths = tuple(folder.root / "reports" / f"{name}.png" for name in NAMES)
    paths[0].parent.mkdir(exist_ok=True)
    for figure, path in zip(figures, paths, strict=True):
        figure.savefig(path, bbox_inches="tight")
    return paths


def trajectory_figure(
    grid: Grid, odometry: Odometry, T_world_camera: Array, loops: tuple[LoopVerdict, ...]
) -> Figure:
    """The camera's path on the faded grid: accepted loops, and gaps where frames have no pose."""
    figure, axes = _figure(_extent(grid), "Trajectory")
    axes.imshow(_grid_image(grid), origin="lower", extent=_extent(grid), alpha=0.35)
    for capture in np.unique(odometry.frames.capture):
        _draw_path(axes, T_world_camera[odometry.frames.capture == capture, :2, 3])
    rows = [keyframe.row for keyframe in odometry.keyframes]
    ends = np.array([[rows[v.i], rows[v.j]] for v in loops if v.accepted], int).reshape(-1, 2)
    axes.add_collection(
        LineCollection(list(T_world_camera[ends, :2, 3]), colors="#8e24aa", lw=0.5, alpha=0.3)
    )
    axes.plot(*T_world_camera[rows, :2, 3].T, ".", color="#0d47a1", ms=3)
    entries = [
        Line2D([], [], color="#1e88e5", lw=2, label="camera, frame by frame"),
        Line2D([], [], color="#0d47a1", ls="", marker=".", label=f"{len(rows)} keyframes"),
        Line2D([], [], color="#8e24aa", lw=1, label=f"{len(ends)} accepted loops"),
        Line2D([], [], color="#2e7d32", ls="", marker="o", label="start"),
        Line2D([], [], color="#e65100", ls="", marker="s", label="end"),
    ]
    known = np.isfinite(T_world_camera[:, 0, 3])
    if not known.all():
        spans = sum(not found for found, _ in groupby(known))
        label = f"{(~known).sum()} frames without a pose, in {spans} spans"
        entries.append(Line2D([], [], color="#e53935", lw=2, ls=":", label=label))
    _legend(figure, entries)
    return figure


def grid_figure(grid: Grid) -> Figure:
    """The grid, with the area of each state."""
    figure, axes = _figure(_extent(grid), "Grid")
    axes.imshow(_grid_image(grid), origin="lower", extent=_extent(grid), interpolation="nearest")
    names = {FREE: "free", OCCUPIED: "occupied", UNKNOWN: "unknown"}
    _legend(
        figure,
        [
            Patch(
                facecolor=np.array(COLORS[state]) / 255,
                edgecolor="#90a4ae",
                label=f"{name}, {grid.area_m2(state):.1f} m²",
            )
            for state, name in names.items()
        ],
    )
    return figure


def cloud_figure(cloud: PointCloud) -> Figure:
    """The cloud seen from above, shaded by height."""
    shown = cloud.points_world[:, 2] < CUT_M
    points, colors = cloud.points_world[shown], cloud.colors[shown]
    low, high = points[:, :2].min(0), points[:, :2].max(0)
    pixel_m = max(PIXEL_M, float((high - low).max()) / LONGEST_PX)
    image = _seen_from_above(points, colors, pixel_m)
    height, width = image.shape[:2]
    x, y = float(low[0]), float(low[1])
    extent = (x, x + width * pixel_m, y, y + height * pixel_m)
    figure, axes = _figure(extent, f"Cloud, up to {CUT_M:g} m above the floor")
    axes.imshow(image, origin="lower", extent=extent)
    return figure


def _seen_from_above(
    points: NDArray[np.float32], colors: NDArray[np.uint8], pixel_m: float
) -> Array:
    """RGB (H, W, 3) in 0 to 1 of the highest point in each pixel, darker beside higher ones."""
    column, row = np.floor((points[:, :2] - points[:, :2].min(0)) / pixel_m).astype(int).T
    rising = np.argsort(points[:, 2], kind="stable")
    image = np.full((row.max() + 1, column.max() + 1, 4), np.nan)
    image[row[rising], column[rising], :3] = colors[rising] / 255
    image[row[rising], column[rising], 3] = points[rising, 2]
    around = _around(image)
    count = np.isfinite(around[..., 3]).sum(0)
    hole = np.isnan(image[..., 3]) & (count >= FILLED_BY)
    image[hole] = np.nansum(around[:, hole], 0) / count[hole, None]
    rises_m = np.clip(_around(image[..., 3:])[..., 0] - image[..., 3], 0, 1)
    shade = np.exp(-SHADE_PER_M * np.nan_to_num(rises_m).mean(0))
    return np.where(np.isnan(image[..., 3:]), BACKGROUND, image[..., :3] * shade[..., None])


def _around(image: Array) -> Array:
    """The eight neighbours (8, H, W, C) of each pixel, NaN outside."""
    height, width = image.shape[:2]
    padded = np.pad(image, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
    shifts = [(y, x) for y in range(3) for x in range(3) if (y, x) != (1, 1)]
    return np.array([padded[y : y + height, x : x + width] for y, x in shifts])


def _grid_image(grid: Grid) -> NDArray[np.uint8]:
    palette = np.array([COLORS[state] for state in (FREE, OCCUPIED, UNKNOWN)], np.uint8)
    return np.asarray(palette[grid.cells])


def _draw_path(axes: Axes, path_xy: Array) -> None:
    """One capture's path (N, 2): NaN where a frame has no pose, which the dotted lines bridge."""
    axes.plot(*path_xy.T, color="#1e88e5", lw=1.8, solid_capstyle="round")
    known = np.flatnonzero(np.isfinite(path_xy[:, 0]))
    for before, after in zip(known[:-1], known[1:], strict=True):
        if after > before + 1:
            axes.plot(*path_xy[[before, after]].T, color="#e53935", lw=1.8, ls=":")
    if len(known):
        axes.plot(*path_xy[known[0]], "o", color="#2e7d32", ms=7, zorder=5)
        axes.plot(*path_xy[known[-1]], "s", color="#e65100", ms=6, zorder=5)


def _extent(grid: Grid) -> tuple[float, float, float, float]:
    (x, y), (rows, columns) = grid.origin, grid.cells.shape
    return x, x + columns * grid.resolution_m, y, y + rows * grid.resolution_m


def _figure(extent: tuple[float, float, float, float], title: str) -> tuple[Figure, Axes]:
    """A figure in the map's proportions, axes in metres, with a scale bar."""
    width, height = extent[1] - extent[0], extent[3] - extent[2]
    inches = 10 / max(width, height)
    size = (max(width * inches, 5) + 0.8, max(height * inches, 2) + 1.3)
    figure = Figure(size, dpi=150, layout="constrained")
    axes = figure.add_subplot(title=title, xlabel="x / m", ylabel="y / m", aspect="equal")
    axes.set(xlim=extent[:2], ylim=extent[2:])
    axes.spines[["top", "right"]].set_visible(False)
    bar_m = next(length for length in (5, 2, 1, 0.5, 0.2) if length < width / 4 or length == 0.2)
    above = {"loc": "lower right", "bbox_to_anchor": (1, 1), "bbox_transform": axes.transAxes}
    axes.add_artist(
        AnchoredSizeBar(axes.transData, bar_m, f"{bar_m:g} m", frameon=False, **above)
    )
    return figure, axes


def _legend(figure: Figure, entries: Sequence[Artist]) -> None:
    figure.legend(handles=entries, loc="outside lower center", ncols=3, frameon=False)
