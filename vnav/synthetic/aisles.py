"""Aisles whose content repeats: a library of identical books, a supermarket of boxes and tiles."""

import numpy as np

from vnav.synthetic.furniture import (
    EDGE,
    HEIGHT_M,
    WALL_M,
    Piece,
    block,
    floor_and_ceiling,
    hung,
    table,
    wall,
)
from vnav.synthetic.scene import Box, Scene, closed_tour, placed, twins

PERIODS_M = 0.08, 0.20  # after how much of a shelf its content repeats, drawn by the seed
LENGTH_M, WIDTH_M = 8.0, 3.2  # of the hall
SHELVES, SHELF_M = 5, 1.2  # on a side; width of one, about: a whole number of periods
DEPTH_M, BOARD_M = 0.3, 0.03  # of a shelf
ROWS, ROW_M = 5, 0.36  # of a shelf, and from board to board
TILE_M = 0.2
BOUNDS = 0, 0, LENGTH_M, WIDTH_M, HEIGHT_M
ALONG_BOTH_SIDES = closed_tour(
    (1.9, 1.3, 80),
    (3.2, 1.25, 100),
    (4.6, 1.3, 85),
    (5.9, 1.35, 70),
    (6.3, 1.6, 0),
    (5.9, 1.85, -70),
    (4.6, 1.9, -95),
    (3.2, 1.95, -80),
    (1.9, 1.9, -110),
    (1.6, 1.6, -180),
)
ALONG_ONE_SIDE = closed_tour(
    (2.7, 1.3, 88),
    (4.0, 1.2, 94),
    (5.3, 1.3, 90),
    (5.2, 1.5, 84),
    (4.0, 1.55, 90),
    (2.8, 1.5, 96),
)


def library(seed: int) -> Scene:
    """An aisle between two rows of identical shelves, each of the same books period by period.

    Steel boards and a table top are bare. The floor and a board on each shelf look like nothing
    else, but faintly; so does what is at the ends of the aisle.
    """
    pieces = [
        *floor_and_ceiling(*BOUNDS[:4], "plaster"),
        *_ends(),
        wall((0, 0), (LENGTH_M, 0), "wallpaper"),
        wall((0, WIDTH_M), (LENGTH_M, WIDTH_M), "wallpaper"),
        placed(table(1.4, 0.8)[1:], LENGTH_M - 0.6, 1.6, 180),
        placed([block(0, 0, 0.69, (0.8, 1.4, 0.05), "bare")], LENGTH_M - 0.6, 1.6, 180),
    ]
    for y, yaw_deg in ((EDGE, 90), (WIDTH_M - EDGE, -90)):
        pieces += _row_of_shelves(period_of(seed), y, yaw_deg, "books", "plaster")
    return Scene(tuple(pieces), BOUNDS, ALONG_BOTH_SIDES, seed)


def library_bare(seed: int) -> Scene:
    """The same books on a shelf without end, above a bare floor: nothing in view is unique.

    From the walk, which is along one side, a view moved by the period is the same view.
    """
    period_m = period_of(seed)
    columns = round(LENGTH_M / period_m)
    pieces = [
        (block(LENGTH_M / 2, WIDTH_M / 2, -0.1, (LENGTH_M, WIDTH_M, 0.1), "bare"),),
        (block(LENGTH_M / 2, WIDTH_M / 2, HEIGHT_M, (LENGTH_M, WIDTH_M, 0.1), "bare"),),
        *(_plain_wall(x, WIDTH_M / 2, WIDTH_M, 0) for x in (0, LENGTH_M)),
        *(_plain_wall(LENGTH_M / 2, y, LENGTH_M, 90) for y in (0, WIDTH_M)),
        *_shelf(period_m, columns, LENGTH_M / 2, EDGE + DEPTH_M / 2, 90, "books"),
        *_shelf(period_m, columns, LENGTH_M / 2, WIDTH_M - EDGE - DEPTH_M / 2, -90, "books"),
    ]
    return Scene(tuple(pieces), BOUNDS, ALONG_ONE_SIDE, seed)


def supermarket(seed: int) -> Scene:
    """Shelves of boxes that are all the same, before a wall and a floor of equal tiles.

    Posters on the wall, a price card on each shelf and the ends of the hall are unique.
    """
    pieces = [
        floor_and_ceiling(*BOUNDS[:4], "bare")[1],
        *_ends(),
        wall((0, WIDTH_M), (LENGTH_M, WIDTH_M), "bare"),
        *_row_of_shelves(period_of(seed), WIDTH_M - EDGE, -90, "carton", "painting"),
        *(placed(hung(0.6, 0.8, 1.1, "painting"), x, EDGE, 90) for x in np.arange(0.8, 7.5, 1.3)),
    ]
    across, along, up = (int(size / TILE_M) for size in (WIDTH_M, LENGTH_M, HEIGHT_M))
    for k in range(along):
        x = (k + 0.5) * TILE_M
        for row in range(across):
            tile = block(0, 0, -WALL_M, (TILE_M, TILE_M, WALL_M), "tiles")
            pieces += twins("floor", [placed([tile], x, (row + 0.5) * TILE_M, 0)])
        for row in range(up):
            tile = block(0, 0, row * TILE_M, (WALL_M, TILE_M, TILE_M), "tiles")
            pieces += twins("wall", [placed([tile], x, 0, 90)])
    return Scene(tuple(pieces), BOUNDS, ALONG_BOTH_SIDES, seed)


def period_of(seed: int) -> float:
    """After how many metres of a shelf its content repeats, in the scenes of that seed."""
    return float(np.random.default_rng([seed, 4]).uniform(*PERIODS_M))


def _ends() -> list[Piece]:
    return [
        wall((0, 0), (0, WIDTH_M), "plaster"),
        wall((LENGTH_M, 0), (LENGTH_M, WIDTH_M), "plaster"),
        placed(hung(1.4, 1.0, 1.4, "painting"), EDGE, 1.5, 0),
        placed(hung(1.6, 1.1, 1.5, "window"), LENGTH_M - EDGE, 1.7, 180),
    ]


def _plain_wall(x: float, y: float, length_m: float, yaw_deg: float) -> Piece:
    return placed([block(0, 0, 0, (WALL_M, length_m, HEIGHT_M), "bare")], x, y, yaw_deg)


def _row_of_shelves(
    period_m: float, y: float, yaw_deg: float, front: str, card: str
) -> list[Piece]:
    """Identical shelves along the wall at y, a card on each; what they stand on is out of view."""
    columns = round(SHELF_M / period_m)
    pitch_m = columns * period_m
    inwards = np.sin(np.deg2rad(yaw_deg))
    pieces: list[Piece] = []
    for k in range(SHELVES):
        x = LENGTH_M / 2 + (k - (SHELVES - 1) / 2) * pitch_m
        pieces += _shelf(period_m, columns, x, y + inwards * DEPTH_M / 2, yaw_deg, front)
        hangs = hung(0.36, 0.46, 1.1, card)
        pieces.append(placed(hangs, x, y + inwards * DEPTH_M, yaw_deg))
    return pieces


def _shelf(
    period_m: float, columns: int, x: float, y: float, yaw_deg: float, front: str
) -> list[Piece]:
    """A steel shelf about x, y, and what stands on it: columns that are twins, side by side."""
    frame = placed(_frame(columns * period_m), x, y, yaw_deg)
    offsets = (np.arange(columns) - (columns - 1) / 2) * period_m
    filled = [placed(_column(o, period_m, front), x, y, yaw_deg) for o in offsets]
    return [*twins("frame", [frame]), *(twins(front, [column])[0] for column in filled)]


def _frame(width_m: float) -> list[Box]:
    """Boards and a back of painted steel."""
    height = ROWS * ROW_M + BOARD_M
    boards = [block(0, 0, k * ROW_M, (DEPTH_M, width_m, BOARD_M), "bare") for k in range(ROWS + 1)]
    back = block(0.01 - DEPTH_M / 2, 0, 0, (0.02, width_m, height), "bare")
    return [*boards, back]


def _column(offset_m: float, width_m: float, front: str) -> list[Box]:
    """What stands on the boards, one above the other: books side by side, or boxes with gaps."""
    width_m -= 0.0 if front == "books" else 0.015
    height = 0.30 if front == "books" else 0.24
    return [
        block(-0.02, offset_m, k * ROW_M + BOARD_M, (0.22, width_m, height), "wood", front)
        for k in range(ROWS)
    ]
