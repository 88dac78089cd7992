"""Grids as ROS map_server keeps them: an image, and a YAML file that says what it means."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.core.grid import FREE, OCCUPIED, UNKNOWN, Grid
from vnav.errors import MapError
from vnav.io.files import read_bytes, read_text, write_bytes, write_text

# Grey values of FREE, OCCUPIED, UNKNOWN, WALKED: map_server's own
_GRID = np.array([254, 0, 205, 205], np.uint8)
_CORRIDOR = np.array([205, 205, 205, 254], np.uint8)
_MASK = np.array([254, 0, 254, 254], np.uint8)
_KEYS = ("image", "resolution", "origin", "occupied_thresh", "free_thresh")
_ADVICE = "run 'vnav fuse' again, or name a map_server grid of mode trinary"


def write_grid(folder: Path, grid: Grid) -> None:
    """Write grid.pgm, whose first row is the one farthest along y, and grid.yaml.

    Walked cells are unknown there.
    """
    _write(folder, "grid", grid, _GRID)


def write_walked(folder: Path, grid: Grid) -> None:
    """Write walked.pgm and walked.yaml, like the grid: free where it is walked, else unknown."""
    _write(folder, "walked", grid, _CORRIDOR)


def write_keepout(folder: Path, grid: Grid) -> None:
    """Write keepout.pgm and keepout.yaml, the mask of Nav2's keepout filter: free or occupied."""
    _write(folder, "keepout", grid, _MASK)


def _write(folder: Path, name: str, grid: Grid, grey: NDArray[np.uint8]) -> None:
    rows, columns = grid.cells.shape
    header, pixels = b"P5\n%d %d\n255\n" % (columns, rows), grey[grid.cells[::-1]]
    write_bytes(folder / f"{name}.pgm", header + pixels.tobytes())
    x, y = grid.origin
    lines = (
        f"image: {name}.pgm",
        f"resolution: {float(grid.resolution_m)!r}",
        f"origin: [{float(x)!r}, {float(y)!r}, 0.0]",
        "negate: 0",
        "occupied_thresh: 0.65",
        "free_thresh: 0.196",
    )
    write_text(folder / f"{name}.yaml", "\n".join(lines) + "\n")


def read_grid(path: Path) -> Grid:
    """The grid that a YAML file of map_server describes, in mode trinary.

    MapError where the file or its image is missing or damaged, a value is missing, or the grid is
    turned against the world.
    """
    values = _values(path)
    try:
        image = path.parent / values["image"].strip("'\"")
        resolution_m = float(values["resolution"])
        x, y, yaw = (float(word) for word in values["origin"].strip("[]").split(","))
        limits = float(values["occupied_thresh"]), float(values["free_thresh"])
        negate = bool(int(values.get("negate", "0")))
    except (KeyError, ValueError) as error:
        raise MapError(
            f"expected {', '.join(_KEYS)} in {path}, found: {error}; {_ADVICE}"
        ) from error
    if yaw != 0 or resolution_m <= 0 or values.get("mode", "trinary") != "trinary":
        raise MapError(
            f"expected a grid along the world's axes of mode trinary in {path}, found"
            f" yaw {yaw:g}, resolution {resolution_m:g}, mode {values.get('mode')}; {_ADVICE}"
        )
    return Grid((x, y), resolution_m, _states(_pixels(image), limits, negate)[::-1])


def _values(path: Path) -> dict[str, str]:
    """The plain ``key: value`` lines that map_server's files are made of."""
    try:
        text = read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        raise MapError(
            f"expected a grid's YAML file in {path}, found: {error}; {_ADVICE}"
        ) from error
    pairs = (line.split("#")[0].partition(":") for line in text.splitlines())
    return {key.strip(): value.strip() for key, colon, value in pairs if colon}


def _pixels(path: Path) -> NDArray[np.uint8]:
    try:
        data = np.frombuffer(read_bytes(path), np.uint8)
    except OSError as error:
        raise MapError(f"expected a grid's image in {path}, found: {error}; {_ADVICE}") from error
    pixels = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if len(data) else None
    if pixels is None:
        raise MapError(f"expected a grid's image in {path}, found none that is whole; {_ADVICE}")
    return np.asarray(pixels, np.uint8)


def _states(
    pixels: NDArray[np.uint8], limits: tuple[float, float], negate: bool
) -> NDArray[np.uint8]:
    """Cells from grey values: dark is occupied, unless negated."""
    occupancy = (pixels if negate else 255 - pixels.astype(float)) / 255
    known = np.where(occupancy < limits[1], FREE, UNKNOWN)
    return np.where(occupancy > limits[0], OCCUPIED, known).astype(np.uint8)
