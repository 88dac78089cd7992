"""Paths through the house keep clear of what really stands there, and are not much too long."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

pytestmark = pytest.mark.real

PAIRS, SEED = 20, 2
CLEARANCE_M = 0.20
CELL_M = 0.05
ORIGIN_M = np.array([-9.5, -5.7])  # of truth_grid's lower left corner, as its .yaml says


@pytest.fixture(scope="module")
def occupied(house: Any) -> NDArray[np.bool_]:
    """Where something really stands, (rows upwards in y, columns in x)."""
    image = cv2.imread(str(house.capture / "truth_grid.pgm"), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    return np.asarray(image[::-1] < 100)


def test_paths_between_photos_are_found_clear_and_short(
    house: Any,
    occupied: NDArray[np.bool_],
    vnav: Callable[..., Any],
    figures: Callable[[str, str, str], None],
) -> None:
    clear_m = distance_transform_edt(~occupied) * CELL_M
    graph = _graph(clear_m >= CLEARANCE_M)
    clearances, ratios = [], []
    for start, goal in _pairs(house, vnav):
        options = "--map", house.map, "--json"
        planned = json.loads(vnav("plan", "--from", start, "--to", goal, *options).stdout)
        assert planned["found"]
        path = _in_truth(house, planned["path_m"])
        clearances.append(_clearance(path, occupied))
        shortest_m = _shortest(graph, clear_m >= CLEARANCE_M, path[0], path[-1])
        ratios.append(planned["length_m"] / shortest_m)
    figures("house paths found", f"{len(ratios)} of {PAIRS}", "all")
    least, longest = min(clearances), max(ratios)
    figures("house paths: least clearance", f"{least:.3f} m", f"{CLEARANCE_M} m less {CELL_M} m")
    figures("house paths: greatest length over shortest", f"{longest:.3f}", "1.2")
    assert least >= CLEARANCE_M - CELL_M
    assert longest <= 1.2


def _pairs(house: Any, vnav: Callable[..., Any]) -> list[tuple[Path, Path]]:
    """The first pairs of located photos among pairs that a seed draws from all of them.

    So which pairs are asked does not hang on which photos happen to be located.
    """
    options = "--map", house.map, "--json"
    said = vnav("locate", house.capture / "photos", *options, expected=(0, 3)).stdout
    answers = json.loads(said)
    rng = np.random.default_rng(SEED)
    drawn = [rng.choice(len(answers), 2, replace=False) for _ in range(2 * PAIRS)]
    both = [(answers[i], answers[j]) for i, j in drawn]
    located = [pair for pair in both if pair[0]["located"] and pair[1]["located"]]
    return [(Path(a["photo"]), Path(b["photo"])) for a, b in located[:PAIRS]]


def _in_truth(house: Any, path_m: list[list[float]]) -> NDArray[np.float64]:
    """The path (N, 2) in the truth's world, a point every centimetre."""
    points = np.array([(x, y, 0.0, 1.0) for x, y, _ in path_m])
    xy = (points @ house.T_truth_world.T)[:, :2]
    steps = np.linalg.norm(np.diff(xy, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.linspace(0.0, along[-1], int(along[-1] / 0.01) + 2)
    return np.stack([np.interp(at, along, xy[:, k]) for k in range(2)], 1)


def _clearance(path: NDArray[np.float64], occupied: NDArray[np.bool_]) -> float:
    """Distance of the path's nearest point to an occupied cell, taken as a square."""
    cells = np.argwhere(occupied)[:, ::-1] * CELL_M + ORIGIN_M + CELL_M / 2
    nearest = np.inf
    for point in path:
        outside = np.maximum(np.abs(cells - point) - CELL_M / 2, 0.0)
        nearest = min(nearest, float(np.linalg.norm(outside, axis=1).min()))
    return nearest


def _graph(free: NDArray[np.bool_]) -> coo_array:
    """Steps between free cells and their eight neighbours, in metres."""
    number = np.arange(free.size).reshape(free.shape)
    rows, columns, lengths = [], [], []
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        a = number[: free.shape[0] - dy, max(0, -dx) : free.shape[1] - max(0, dx)]
        b = number[dy:, max(0, dx) : free.shape[1] - max(0, -dx)]
        both = free.flat[a] & free.flat[b]
        rows.append(a[both])
        columns.append(b[both])
        lengths.append(np.full(int(both.sum()), np.hypot(dx, dy) * CELL_M))
    parts = (np.concatenate(part) for part in (lengths, rows, columns))
    length, row, column = parts
    return coo_array((length, (row, column)), shape=(free.size, free.size))


def _shortest(
    graph: coo_array,
    free: NDArray[np.bool_],
    start: NDArray[np.float64],
    goal: NDArray[np.float64],
) -> float:
    """Length of the shortest path over free cells between those nearest to start and goal."""
    cells = np.argwhere(free)
    centres = cells[:, ::-1] * CELL_M + ORIGIN_M + CELL_M / 2
    ends = [cells[np.linalg.norm(centres - point, axis=1).argmin()] for point in (start, goal)]
    a, b = (int(row * free.shape[1] + column) for row, column in ends)
    return float(dijkstra(graph.tocsr(), directed=False, indices=a)[b])
