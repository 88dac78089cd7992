"""What closes the way where there is no path: the narrowest place on the widest way."""

import heapq
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.core.arrays import Array
from vnav.core.frame import Rejected
from vnav.core.grid import OCCUPIED, Grid
from vnav.planning.astar import Cell, Whole
from vnav.planning.costmap import Costmap, radii_m
from vnav.planning.lanes import MOVES
from vnav.planning.snapping import Point

Cells = NDArray[np.intp]


@dataclass(frozen=True)
class NarrowPlace:
    """Where a way is narrowest, in metres.

    ``sides`` (2, 2): where the obstacles on both sides are nearest, ``width_m`` apart; (1, 2) where
    one side alone is an obstacle, so far from ``at``. ``needed_m``: the width at which the robot
    passes for sure; ``turning_m``: at which it also turns, whatever its outline.
    """

    at: Point
    sides: Array
    width_m: float
    needed_m: float
    turning_m: float

    @property
    def text(self) -> str:
        """The end of a sentence; to a centimetre, what is needed rounded up, what is there down."""
        there = f"the narrowest place on the widest way is at ({self.at[0]:.2f}, {self.at[1]:.2f})"
        width, needed, turning = (
            self.width_text,
            *(f"{np.ceil(100 * m - 1e-6) / 100:.2f} m" for m in (self.needed_m, self.turning_m)),
        )
        needs = f"the robot needs {needed}"
        if turning != needed:
            needs += f" to pass straight and {turning} to turn"
        wide = f"{width} wide" if len(self.sides) == 2 else f"{width} beside an obstacle"
        lacks = "it has room to pass straight, but not to turn: " if self.is_passable else ""
        return f"{lacks}{there}, {wide}; {needs}"

    @property
    def width_text(self) -> str:
        """Its width to a centimetre, rounded down."""
        return f"{np.floor(100 * self.width_m + 1e-6) / 100:.2f} m"

    @property
    def is_passable(self) -> bool:
        """Whether the robot passes there as long as it need not turn."""
        return self.width_m >= self.needed_m


@dataclass(frozen=True)
class NoPath(Rejected):
    """Why there is no path; ``narrowest`` where width is what lacks."""

    narrowest: NarrowPlace | None = None


def narrowest_place(
    wide: Costmap, costs: Costmap, starts: Cells, goals: Cells
) -> NarrowPlace | None:
    """Where the widest way from one of some cells (M, 2) to one of others is narrowest.

    None where no way joins them, or the robot passes there. ``wide``: the floor as a robot without
    width sees it; ``costs``: as the robot does. One-ways are kept to.
    """
    grid, barred = wide.grid, wide.barred
    ends = np.zeros(grid.cells.shape, np.uint8)
    for bit, cells in ((1, starts), (2, goals)):
        ends[tuple(cells.T)] |= bit
    clearance_m = np.where(wide.costs > 0, wide.clearance_m, -1.0)
    barred = np.zeros(ends.shape, np.uint16) if barred is None else barred
    joint = int(_bottleneck(clearance_m, barred, ends))
    if joint < 0 or not (grid.cells == OCCUPIED).any():
        return None
    place = _place(grid, divmod(joint, grid.cells.shape[1]), costs)
    return place if place.width_m < place.turning_m else None


def _place(grid: Grid, cell: Cell, costs: Costmap) -> NarrowPlace:
    """How wide it is at a cell: between the nearest obstacle and the nearest one opposite to it."""
    (x, y), needs_m = grid.centres_of(cell).tolist(), _needs_m(costs)
    obstacles = np.argwhere(grid.cells == OCCUPIED)
    towards = obstacles - cell
    near = np.hypot(*towards.T).argmin()
    opposite = obstacles[towards @ towards[near] < 0]
    gaps = np.hypot(*np.maximum(np.abs(opposite - obstacles[near]) - 1, 0).T) * grid.resolution_m
    if len(gaps) and gaps.min() < needs_m[1]:
        sides = _facing(obstacles[near], opposite[gaps.argmin()])[:, ::-1]
        on_floor = sides * grid.resolution_m + grid.origin
        return NarrowPlace((x, y), on_floor, float(gaps.min()), *needs_m)
    side = np.clip(np.array(cell) + 0.5, obstacles[near], obstacles[near] + 1)[None, ::-1]
    on_floor = side * grid.resolution_m + grid.origin
    away_m = float(np.hypot(*(on_floor[0] - (x, y))))
    return NarrowPlace((x, y), on_floor, away_m, needs_m[0] / 2, needs_m[1] / 2)


def _needs_m(costs: Costmap) -> tuple[float, float]:
    """Widths at which the robot passes, and turns, wherever cells lie: a diagonal to spare."""
    spare_m = costs.uncertainty_m + costs.grid.resolution_m * np.sqrt(0.5)
    inner_m, outer_m = radii_m(costs.config)
    return float(2 * (inner_m + spare_m)), float(2 * (outer_m + spare_m))


def _facing(a: NDArray[np.intp], b: NDArray[np.intp]) -> Array:
    """The points (2, 2) of two cells that are nearest to each other; in cells."""
    on_a = np.where(a < b, a + 1.0, np.where(a > b, a, a + 0.5))
    on_b = np.where(b < a, b + 1.0, np.where(b > a, b, b + 0.5))
    return np.stack([on_a, on_b])


@compiled
def _bottleneck(clearance: Array, barred: NDArray[np.uint16], ends: NDArray[np.uint8]) -> int:
    """The cell of least clearance on the widest way from a start to a goal, -1 where none is.

    By Dijkstra's algorithm, with the least clearance so far in the place of a length (Pollack
    1960), over the moves of `astar.search`. All are (rows, columns); clearance is below 0 where
    nothing passes; ``ends``: bit 0 of starts, bit 1 of goals.
    """
    columns = ends.shape[1]
    width, narrowest = np.full(ends.shape, -1.0), np.zeros(ends.shape, np.int64)
    queue = _starts(clearance, ends)
    for found, node in queue:
        width.flat[node], narrowest.flat[node] = -found, node
    while len(queue) > 0:
        found, node = heapq.heappop(queue)
        r, c = node // columns, node % columns
        if -found < width[r, c]:
            continue
        if ends[r, c] & 2:
            return int(narrowest[r, c])
        for k in range(len(MOVES)):
            i, j = r + MOVES[k][0], c + MOVES[k][1]
            inside = 0 <= i < ends.shape[0] and 0 <= j < columns
            if not inside or barred[r, c] >> k & 1:
                continue
            at = _narrower(clearance, narrowest[r, c], (r, c), (i, j))
            if clearance.flat[at] > width[i, j]:
                width[i, j], narrowest[i, j] = clearance.flat[at], at
                heapq.heappush(queue, (-width[i, j], np.int64(i * columns + j)))
    return -1


@compiled
def _starts(clearance: Array, ends: NDArray[np.uint8]) -> list[tuple[Whole, Whole]]:
    """A queue of the starts that something passes, the widest first."""
    queue = [
        (-clearance.flat[node], np.int64(node))
        for node in range(ends.size)
        if ends.flat[node] & 1 and clearance.flat[node] >= 0
    ]
    heapq.heapify(queue)
    return queue


@compiled
def _narrower(clearance: Array, at: int, a: Cell, b: Cell) -> int:
    """Of a cell and all that a move from a to b passes, the one with the least clearance."""
    for row, column in (b, (b[0], a[1]), (a[0], b[1])):
        if clearance[row, column] < clearance.flat[at]:
            at = row * clearance.shape[1] + column
    return at
