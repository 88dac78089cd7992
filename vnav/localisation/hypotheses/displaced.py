"""Views from which a map that repeats itself looks as from a given one, but for a displacement.

Books on a shelf, windows and tiles repeat themselves within one place. Each is the second-nearest
of the next, so the ratio test leaves few matches of them, and a covisibility cluster keeps one
landmark a feature. The matches of a pose tell of its rivals nevertheless: other landmarks look like
theirs, many of them as far off in the same direction.
"""

import numpy as np

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.localisation.inverted_file import nearest_distinct
from vnav.localisation.matches import Matches
from vnav.localisation.query import MIN_MATCHES, Query
from vnav.localisation.view import View

NEAREST = 16  # in descriptors, which a landmark is compared with
LIKE = 1.2  # up to this distance, over the typical distractor's, two landmarks look alike
CELL_M = 0.05  # displacements in one cell count as one
SAME_M = 0.08  # and those that differ by less
MIN_SHARE = 0.1  # of the landmarks that a displacement must explain
MOST = 8  # displacements


def displaced(view: View, matches: Matches, query: Query) -> list[View]:
    """The view where the map repeats what matches there, the most frequent displacement first."""
    found = frequent(displacements(matches, query), max(MIN_MATCHES, MIN_SHARE * len(matches)))
    back = [se3.make(np.eye(3), -displacement) for displacement in found]
    return [View(view.T_camera_world @ T, view.intrinsics) for T in back]


def displacements(matches: Matches, query: Query) -> Array:
    """From the landmarks of the matches to those that look like them (N, 3), in metres."""
    database, index = query.database, query.database.index
    words = database.words(matches.row, query.level_2d_3d)
    like, distance = nearest_distinct(
        index.descriptors[matches.row], index.span[words], database.inverted_file, NEAREST
    )
    points = index.points_world
    ways = points[index.owner[like]] - points[matches.landmark][:, None]
    near = distance < LIKE * index.distractor_distance
    return np.asarray(ways[near & (np.linalg.norm(ways, axis=2) > SAME_M)], float)


def frequent(ways: Array, min_count: float) -> list[Array]:
    """Displacements (3,) that at least so many of some (N, 3) agree on, the most frequent first.

    `MOST` of them at most.
    """
    if not len(ways):
        return []
    cell_of = np.round(ways / CELL_M).astype(int)
    lowest, sizes = cell_of.min(0), tuple(np.ptp(cell_of, axis=0) + 1)
    numbers = np.ravel_multi_index(tuple((cell_of - lowest).T), sizes)
    _, row, count = np.unique(numbers, return_index=True, return_counts=True)
    cells = cell_of[row]
    order = np.argsort(-count, kind="stable")
    found: list[Array] = []
    for cell in cells[order[count[order] >= min_count]]:
        near = np.linalg.norm(ways - cell * CELL_M, axis=1) < 1.5 * CELL_M
        way = np.median(ways[near], axis=0)
        if all(np.linalg.norm(way - other) > SAME_M for other in found):
            found.append(way)
        if len(found) == MOST:
            break
    return found
