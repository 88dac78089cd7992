"""What pictures share: axes in metres, the grid, a legend, a file that is written whole."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.transforms import offset_copy

from vnav.core.arrays import Array
from vnav.core.grid import FREE, OCCUPIED, UNKNOWN, WALKED, Grid
from vnav.errors import VnavError
from vnav.io.files import whole_file

COLORS = {FREE: "#ffffff", OCCUPIED: "#263238", UNKNOWN: "#d6dade", WALKED: "#b2dfdb"}
BAR_PT, TITLE_PT = 6, 26  # above the axes, in points: the scale bar with its length, the title
Extent = tuple[float, float, float, float]  # left, right, bottom, top in metres


def map_figure(extent: Extent, title: str, longest_in: float = 10.0) -> tuple[Figure, Axes]:
    """A figure in the map's proportions, axes in metres, with a scale bar.

    ``longest_in``: the longer side in inches; the smaller it is, the larger is the text beside it.
    """
    width, height = extent[1] - extent[0], extent[3] - extent[2]
    inches = longest_in / max(width, height)
    size = (max(width * inches, longest_in / 2) + 0.8, max(height * inches, longest_in / 5) + 1.3)
    figure = Figure(size, dpi=150, layout="constrained")
    axes = figure.add_subplot(xlabel="x / m", ylabel="y / m", aspect="equal")
    axes.set_title(title, pad=TITLE_PT)
    axes.set(xlim=extent[:2], ylim=extent[2:])
    axes.spines[["top", "right"]].set_visible(False)
    bar_m = next(length for length in (5, 2, 1, 0.5, 0.2) if length < width / 4 or length == 0.2)
    _draw_scale(figure, axes, extent[1], bar_m)
    return figure, axes


def _draw_scale(figure: Figure, axes: Axes, right: float, bar_m: float) -> None:
    """A bar of so many metres above the right corner, below the title."""
    above = axes.get_xaxis_transform()
    bar, text = (offset_copy(above, figure, 0, pt, units="points") for pt in (BAR_PT, BAR_PT + 4))
    axes.plot([right - bar_m, right], [1, 1], "k|-", ms=6, lw=1.5, transform=bar, clip_on=False)
    axes.text(right - bar_m / 2, 1, f"{bar_m:g} m", ha="center", va="bottom", transform=text)


def grid_image(grid: Grid) -> Array:
    """The grid as RGB (rows, columns, 3), the first row at the bottom."""
    palette = np.array([to_rgb(COLORS[state]) for state in sorted(COLORS)])
    return np.asarray(palette[grid.cells])


def extent_of(grid: Grid) -> Extent:
    """Where the edges of a grid lie in the world."""
    (x, y), (rows, columns) = grid.origin, grid.cells.shape
    return x, x + columns * grid.resolution_m, y, y + rows * grid.resolution_m


def legend(figure: Figure, entries: Sequence[Artist]) -> None:
    """A legend below the axes."""
    figure.legend(handles=entries, loc="outside lower center", ncols=3, frameon=False)


def save(figure: Figure, path: Path, option: str, **how: Any) -> None:
    """Write a figure, ``how`` as matplotlib has it; VnavError, which names the option, if not."""
    try:
        with whole_file(path) as file:
            figure.savefig(file, **how)
    except OSError as error:
        raise VnavError(
            f"expected to write {path}, found: {error.strerror}; name another file with {option}"
        ) from error
