"""Two rooms, one above the other, and a stair between them."""

from collections.abc import Iterable
from dataclasses import replace

from vnav.synthetic.furniture import (
    EDGE,
    HEIGHT_M,
    Piece,
    block,
    chair,
    cupboard,
    hung,
    rug,
    shelf,
    sofa,
    table,
    wall,
)
from vnav.synthetic.scene import Scene, closed_tour, placed

X_M, Y_M = 7.0, 5.0
STOREY_M = HEIGHT_M + 0.2  # from floor to floor
STEPS, TREAD_M, STAIR_M = 15, 0.26, 1.1  # the stair: steps, depth of each, width
FOOT_M = 1.4  # x where the stair begins
HEAD_M = FOOT_M + STEPS * TREAD_M  # where it ends


def two_storeys(seed: int) -> Scene:
    """A room of 7 x 5 m, a stair along its wall, and a room like it above; down the same way."""
    pieces = [
        (block(X_M / 2, Y_M / 2, -0.1, (X_M, Y_M, 0.1), "tiles"),),
        *_walls(),
        _stair(),
        *_slab(),
        *_raised(_walls()),
        (block(X_M / 2, Y_M / 2, STOREY_M + HEIGHT_M, (X_M, Y_M, 0.1), "plaster"),),
        *_below(),
        *_raised(_above()),
    ]
    return Scene(tuple(pieces), (0, 0, X_M, Y_M, STOREY_M + HEIGHT_M), _tour(), seed)


def _walls() -> list[Piece]:
    """Around one storey."""
    return [
        wall((0, 0), (X_M, 0), "wallpaper"),
        wall((0, Y_M), (X_M, Y_M), "wallpaper"),
        wall((0, 0), (0, Y_M), "plaster"),
        wall((X_M, 0), (X_M, Y_M), "plaster"),
        placed(hung(1.6, 1.0, 1.5, "painting"), 3.0, EDGE, 90),
        placed(hung(1.2, 0.8, 1.5, "painting"), 5.4, EDGE, 90),
        placed(hung(1.4, 1.1, 1.5, "window"), EDGE, 2.6, 0),
        placed(hung(1.0, 0.8, 1.5, "painting"), X_M - EDGE, 1.6, 180),
        placed(hung(1.5, 1.1, 1.5, "window"), 2.2, Y_M - EDGE, -90),
    ]


def _stair() -> Piece:
    """Solid steps along y = 0, up along x."""
    rise = STOREY_M / STEPS
    return tuple(
        block(
            FOOT_M + (k + 0.5) * TREAD_M,
            EDGE + STAIR_M / 2,
            0,
            (TREAD_M, STAIR_M, (k + 1) * rise),
            "wood",
        )
        for k in range(STEPS)
    )


def _slab() -> list[Piece]:
    """The floor above, which is the ceiling below, with an opening over the stair."""
    z, thick_m = HEIGHT_M, STOREY_M - HEIGHT_M
    side, rest = EDGE + STAIR_M, Y_M - EDGE - STAIR_M
    return [
        (block(X_M / 2, side + rest / 2, z, (X_M, rest, thick_m), "planks"),),
        (block(FOOT_M / 2, side / 2, z, (FOOT_M, side, thick_m), "planks"),),
        (block((HEAD_M + X_M) / 2, side / 2, z, (X_M - HEAD_M, side, thick_m), "planks"),),
    ]


def _below() -> list[Piece]:
    return [
        placed(sofa(1.9), 0.6, 2.6, 0),
        placed(shelf(1.4, 6), 6.75, 3.4, 180),
        placed(cupboard(1.5, 0.9), 4.6, 4.7, -90),
        placed(table(1.0, 0.55, 0.42), 2.0, 2.7, 0),
        placed(chair(), 5.6, 3.4, 200),
    ]


def _above() -> list[Piece]:
    return [
        placed(shelf(1.6, 5), 0.22, 3.4, 0),
        placed(table(1.4, 0.8), 6.5, 3.6, 180),
        placed(chair(), 5.8, 3.6, 10),
        placed(cupboard(1.2, 1.3), 3.6, 4.7, -90),
        placed(rug(1.8, 1.2), 3.4, 2.9, 20),
    ]


def _raised(pieces: Iterable[Piece]) -> list[Piece]:
    """Pieces of the storey above."""
    return [
        tuple(replace(b, centre=(*b.centre[:2], b.centre[2] + STOREY_M)) for b in p) for p in pieces
    ]


def _tour() -> tuple[tuple[float, ...], ...]:
    """Around below, up the stair, around above looking across, and down again."""
    y = EDGE + STAIR_M / 2
    below, above = 0.0, STOREY_M
    return closed_tour(
        (0.8, 0.8, 60, below),
        (1.6, 1.9, 30, below),
        (3.4, 1.9, 40, below),
        (4.9, 2.2, 90, below),
        (4.6, 3.3, 170, below),
        (3.2, 3.6, 210, below),
        (2.8, 2.0, 215, below),
        (1.4, 1.6, 290, below),
        (0.9, y, 360, below),
        (FOOT_M, y, 360, below),
        (HEAD_M, y, 360, above),
        (HEAD_M + 0.5, 1.0, 420, above),
        (5.4, 2.2, 480, above),
        (3.6, 2.0, 500, above),
        (1.8, 2.0, 540, above),
        (1.6, 3.2, 620, above),
        (3.2, 3.6, 720, above),
        (4.8, 2.8, 710, above),
        (6.0, 1.4, 640, above),
        (HEAD_M + 0.6, y, 540, above),
        (HEAD_M, y, 540, above),
        (FOOT_M, y, 540, below),
        (1.0, 0.7, 500, below),
    )
