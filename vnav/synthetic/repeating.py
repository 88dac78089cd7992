"""Scenes that repeat themselves: rooms and shelves that look the same in every detail."""

from vnav.synthetic.furniture import (
    EDGE,
    HEIGHT_M,
    Piece,
    bed,
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

ROOM_M = 4.0
CORRIDOR_M = 1.8
SHELF_M = 1.3  # from one shelf of the shop to the next
SHELVES = 6  # in a row


def twin_rooms(seed: int) -> Scene:
    """Two rooms of 4 x 4 m, the same but for a picture in each, off a corridor that is not."""
    x1, y1 = 2 * ROOM_M, 1.8 + ROOM_M
    own = placed(hung(0.9, 0.7, 1.5, "painting"), 1.2, 5.8 - EDGE, -90)
    other = placed(hung(0.9, 0.7, 1.5, "painting"), 1.2 + ROOM_M, 5.8 - EDGE, -90)
    pieces = [
        *floor_and_ceiling(0, 0, x1, 1.75, "tiles"),
        wall((0, 0), (x1, 0), "wallpaper"),
        wall((0, 0), (0, 1.8), "plaster"),
        wall((x1, 0), (x1, 1.8), "plaster"),
        placed(cupboard(1.2, 0.9, 0.4), 4.2, 0.26, 90),
        placed(hung(1.1, 0.8, 1.5, "painting"), 1.6, EDGE, 90),
        placed(hung(0.8, 1.0, 1.5, "painting"), 6.6, EDGE, 90),
        placed(hung(0.9, 1.2, 1.5, "window"), EDGE, 0.9, 0),
        placed(hung(0.8, 0.6, 1.6, "painting"), x1 - EDGE, 0.9, 180),
        placed(hung(0.6, 0.7, 1.5, "painting"), 4.1, 1.8 - EDGE, -90),
        *twins("room", furnished_room(0.0)),
        *twins("room", furnished_room(ROOM_M)),
        own,
        other,
    ]
    inside = ((2.0, 1.9, 90), (2.4, 3.2, 60), (2.1, 4.0, 150), (1.6, 3.9, 240), (2.0, 2.6, 300))
    tour = closed_tour(
        (0.9, 0.9, 0),
        (1.6, 1.0, 60),
        *inside,
        (2.1, 1.7, 290),
        (3.6, 0.9, 350),
        (5.6, 1.0, 415),
        *((x + ROOM_M, y, yaw + 360) for x, y, yaw in inside),
        (6.4, 1.6, 640),
        (6.9, 0.9, 550),
        (3.6, 0.8, 530),
        (1.4, 0.8, 600),
    )
    return Scene(tuple(pieces), (0, 0, x1, y1, HEIGHT_M), tour, seed)


def shop(seed: int) -> Scene:
    """A hall of two rows of shelves that are all the same; floor and walls are not."""
    x1, y1 = SHELVES * SHELF_M + 0.6, 5.0
    pieces = [
        *floor_and_ceiling(0, 0, x1, y1, "planks"),
        wall((0, 0), (x1, 0), "wallpaper"),
        wall((0, y1), (x1, y1), "wallpaper"),
        wall((0, 0), (0, y1), "plaster"),
        wall((x1, 0), (x1, y1), "plaster"),
        placed(hung(1.2, 0.9, 1.5, "painting"), EDGE, 2.5, 0),
        placed(hung(1.6, 1.1, 1.5, "window"), x1 - EDGE, 2.3, 180),
        placed(cupboard(0.6, 1.1), x1 - 0.4, 3.9, 180),
    ]
    for k in range(SHELVES):
        x = 0.3 + SHELF_M * (k + 0.5)
        pieces += twins("shelf", [placed(shelf(1.2, 6), x, 0.25, 90)])
        pieces += twins("shelf", [placed(shelf(1.2, 6), x, y1 - 0.25, -90)])
    tour = closed_tour(
        (1.0, 2.6, 290),
        (2.5, 2.7, 280),
        (4.0, 2.6, 265),
        (5.8, 2.7, 290),
        (7.0, 2.6, 350),
        (7.0, 2.4, 430),
        (5.5, 2.3, 445),
        (4.0, 2.4, 460),
        (2.5, 2.3, 440),
        (1.3, 2.4, 500),
        (1.0, 2.5, 580),
    )
    return Scene(tuple(pieces), (0, 0, x1, y1, HEIGHT_M), tour, seed)


def furnished_room(x0: float) -> list[Piece]:
    """A furnished room from x0 on, its door to the corridor, which is 1.8 m wide."""
    x1, y0, y1 = x0 + ROOM_M, CORRIDOR_M, CORRIDOR_M + ROOM_M
    return [
        *floor_and_ceiling(x0, y0 - 0.05, x1, y1, "planks"),
        wall((x0, y0), (x1, y0), "wallpaper", doors=(2.0,)),
        wall((x0, y1), (x1, y1), "wallpaper"),
        wall((x0 + EDGE, y0), (x0 + EDGE, y1), "plaster"),
        wall((x1 - EDGE, y0), (x1 - EDGE, y1), "plaster"),
        placed(bed(2.0, 1.4), x0 + 2.84, y1 - 0.85, 180),
        placed(shelf(1.1, 5), x0 + 0.28, y0 + 2.2, 0),
        placed(sofa(1.6), x0 + 3.4, y0 + 1.1, 180),
        placed(table(0.8, 0.5, 0.45), x0 + 0.5, y0 + 0.7, 0),
        placed(hung(1.0, 0.7, 1.6, "painting"), x1 - 2 * EDGE, y0 + 1.8, 180),
        placed(hung(0.7, 0.9, 1.5, "painting"), x0 + 0.9, y0 + EDGE, 90),
        placed(rug(1.5, 1.0), x0 + 1.9, y0 + 2.0, 80),
    ]
