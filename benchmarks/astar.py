"""A* against pyastar2d and scikit-image, in turns, on the same grids of 1000 x 1000 cells.

Each gets the same costs and the same ends; the medians of the ratios of neighbouring runs are what
other load on the machine hardly touches. vnav and scikit-image declare the same cost (a move's
length times the mean of its two cells), pyastar2d that of the cell entered, diagonally or not; only
vnav does not cut corners, so on grids with blocked cells its routes are a little longer and its
search is the harder one. Exit code 1 where vnav takes more than twice as long as pyastar2d, or as
long as scikit-image.

    python benchmarks/astar.py [--record]
"""

import argparse
import sys
import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import pyastar2d
from numpy.typing import NDArray
from recording import Measurement, add_record_option, missed, record, table
from scipy import ndimage
from skimage.graph import route_through_array

from vnav.config import PlanConfig
from vnav.core.frame import Rejected
from vnav.core.grid import FREE, OCCUPIED, Grid
from vnav.planning.astar import UNIT, Route, search
from vnav.planning.costmap import costmap

SIZE, RUNS, SLOW_RUNS = 1000, 11, 3
PEERS = (("pyastar2d", "at most 2"), ("scikit-image", "at most 1"))
Cell = tuple[int, int]
Costs = NDArray[np.int32]


def grids() -> Iterator[tuple[str, Costs]]:
    """Names and costs in 1 / UNIT, 0 where blocked."""
    rng = np.random.default_rng(0)
    yield "empty", np.full((SIZE, SIZE), UNIT, np.int32)
    for share in (0.1, 0.2, 0.3):
        blocked = rng.random((SIZE, SIZE)) < share
        yield f"{share:.0%} of cells blocked", np.where(blocked, 0, UNIT).astype(np.int32)
    yield "costs 1 to 2", rng.integers(UNIT, 2 * UNIT, (SIZE, SIZE)).astype(np.int32)
    yield "costs 1 to 10", rng.integers(UNIT, 10 * UNIT, (SIZE, SIZE)).astype(np.int32)
    yield "rooms, as plan sees them", costmap(rooms(rng), 0.0, PlanConfig()).costs


def rooms(rng: np.random.Generator) -> Grid:
    """A building of 50 m x 50 m: walls every 5 m with doors of 1 m, and boxes of up to 1 m."""
    cells = np.full((SIZE, SIZE), FREE, np.uint8)
    for row, column, height, width in rng.integers((0, 0, 4, 4), (SIZE, SIZE, 20, 20), (600, 4)):
        cells[row : row + height, column : column + width] = OCCUPIED
    for wall in range(100, SIZE, 100):
        cells[wall : wall + 3] = cells[:, wall : wall + 3] = OCCUPIED
    for wall in range(100, SIZE, 100):
        for room in range(0, SIZE, 100):
            door = room + int(rng.integers(20, 60))
            cells[wall - 15 : wall + 18, door : door + 20] = FREE
            cells[door : door + 20, wall - 15 : wall + 18] = FREE
    return Grid((0, 0), 0.05, cells)


def ends(costs: Costs) -> tuple[Cell, Cell]:
    """The first and the last cell, along the diagonal, of what is joined."""
    regions, _ = ndimage.label(costs > 0)
    cells = np.argwhere(regions == np.bincount(regions[regions > 0]).argmax())
    order = np.argsort(cells.sum(1), kind="stable")
    start, goal = cells[order[[0, -1]]].tolist()
    return tuple(start), tuple(goal)


def seconds(call: Callable[[], object]) -> float:
    started = time.perf_counter()
    call()
    return time.perf_counter() - started


def compare(costs: Costs, start: Cell, goal: Cell) -> tuple[NDArray[np.float64], Route | Rejected]:
    """Seconds (RUNS, 3) of vnav, pyastar2d and scikit-image, NaN where one was left out."""
    weights = np.where(costs > 0, costs / UNIT, np.inf).astype(np.float32)
    array = np.where(costs > 0, costs / UNIT, -1)
    spent = np.full((RUNS, 3), np.nan)
    for run in spent:
        run[0] = seconds(lambda: search(costs, start, goal))
        run[1] = seconds(lambda: pyastar2d.astar_path(weights, start, goal, allow_diagonal=True))
    for run in spent[:SLOW_RUNS]:
        run[0] = seconds(lambda: search(costs, start, goal))
        run[2] = seconds(lambda: route_through_array(array, start, goal))
    route = search(costs, start, goal)
    if (costs > 0).all() and isinstance(route, Route):
        same = route_through_array(array, start, goal)[1]
        assert abs(route.cost - same) < 5e-4 * same, "the declared cost is not the least"
    return spent, route


def measured(name: str, spent: NDArray[np.float64]) -> Iterator[Measurement]:
    """Medians of the times (RUNS, 3) and of their ratios on one grid."""
    on, what = f"grid of {SIZE} x {SIZE}", f"A*, {name}"
    for k, (peer, wanted) in enumerate(PEERS, 1):
        pairs = spent[np.isfinite(spent[:, k])]
        ours_ms, others_ms = (float(1e3 * np.median(pairs[:, column])) for column in (0, k))
        ratio = float(np.median(pairs[:, 0] / pairs[:, k]))
        yield Measurement(on, what, "wall time, ratio", ratio, "", wanted, peer)
        yield Measurement(on, what, "wall time", ours_ms, "ms", None, peer)
        yield Measurement(on, what, "wall time of the other", others_ms, "ms", None, peer)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a table; 1 where a limit is broken."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    add_record_option(parser)
    asked = parser.parse_args(arguments)
    search(np.full((2, 2), UNIT, np.int32), (0, 0), (1, 1))  # compiled, or loaded from the cache
    found: list[Measurement] = []
    for name, costs in grids():
        spent, route = compare(costs, *ends(costs))
        found += measured(name, spent)
        expanded = route.expanded if isinstance(route, Route) else 0
        print(f"{name}: {expanded} cells expanded", flush=True)
    print(f"\n{table(found)}")
    if asked.record:
        libraries = ("pyastar2d", "scikit-image")
        record("plan_speed", "how fast", found, arguments, libraries=libraries)
    return int(bool(missed(found)))


if __name__ == "__main__":
    sys.exit(main())
