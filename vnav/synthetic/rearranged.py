"""A room before and after somebody was there: a chair moved, a box gone, a door opened."""

import numpy as np

from vnav.synthetic.furniture import (
    DOOR_M,
    EDGE,
    HEIGHT_M,
    Piece,
    block,
    chair,
    cupboard,
    floor_and_ceiling,
    hung,
    rug,
    shelf,
    sofa,
    table,
    wall,
)
from vnav.synthetic.scene import Scene, closed_tour, placed, twins

X_M, Y_M, CORRIDOR_M = 5.0, 4.4, 1.1  # of the room; of the corridor behind its door
DOORWAY_M = 1.3  # its middle, along the wall
LEAF = block(0, 0, 0, (0.04, 0.9, DOOR_M), "wood", "drawers")


def room_before(seed: int) -> Scene:
    """A furnished room, walked around while looking across; its door is closed."""
    moved = placed(chair(), 3.75, 3.3, 10), placed([LEAF], DOORWAY_M, Y_M - 0.02, -90)
    box = placed(cupboard(0.5, 0.5), 3.7, 0.5, 120)
    return _room(seed, [*moved, box], np.arange(0, 360, 45), 0.95)


def room_after(seed: int) -> Scene:
    """The same room, walked around the other way: another place for the chair, no box, door open.

    All that stays looks as it did, and so do chair and door.
    """
    hinge = DOORWAY_M - 0.45
    moved = placed(chair(), 1.25, 0.75, 60), placed([LEAF], hinge + 0.02, Y_M - 0.5, 180)
    return _room(seed, [*moved], np.arange(120, -240, -45), 0.75)


def _room(seed: int, pieces: list[Piece], angles_deg: np.ndarray, radius_m: float) -> Scene:
    """What stays, then other pieces, whose looks do not depend on what else there is."""
    circle = [
        (2.5 + radius_m * np.cos(a), 2.2 + 0.9 * radius_m * np.sin(a), float(np.rad2deg(a)) + 170)
        for a in np.deg2rad(angles_deg)
    ]
    bounds = (0, 0, X_M, Y_M + CORRIDOR_M, HEIGHT_M)
    return Scene((*_what_stays(), *twins("moved", pieces)), bounds, closed_tour(*circle), seed)


def _what_stays() -> list[Piece]:
    end = Y_M + CORRIDOR_M
    return [
        *floor_and_ceiling(0, 0, X_M, Y_M, "planks"),
        *floor_and_ceiling(0, Y_M, X_M, end, "tiles"),
        wall((0, 0), (X_M, 0), "wallpaper"),
        wall((0, Y_M), (X_M, Y_M), "wallpaper", doors=(DOORWAY_M,)),
        wall((0, end), (X_M, end), "wallpaper"),
        wall((0, 0), (0, end), "plaster"),
        wall((X_M, 0), (X_M, end), "plaster"),
        placed(sofa(1.9), 0.55, 2.2, 0),
        placed(hung(1.2, 0.8, 1.55, "painting"), EDGE, 2.2, 0),
        placed(shelf(1.1, 5), 4.75, 1.2, 180),
        placed(table(1.2, 0.7), 4.3, 3.2, 180),
        placed(cupboard(1.2, 0.9), 2.6, 0.32, 90),
        placed(hung(0.7, 0.5, 1.5, "painting"), 2.5, EDGE, 90),
        placed(hung(1.5, 1.1, 1.5, "window"), 3.1, Y_M - EDGE, -90),
        placed(hung(0.5, 0.7, 1.6, "painting"), X_M - EDGE, 3.0, 180),
        placed(hung(0.9, 0.7, 1.5, "painting"), 1.4, end - EDGE, -90),
        placed(rug(1.6, 1.1), 2.4, 2.3, 15),
    ]
