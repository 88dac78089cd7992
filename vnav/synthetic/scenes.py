"""The scenes: an apartment, a single room for quick tests, and those that repeat themselves."""

from collections.abc import Callable

import numpy as np

from vnav.synthetic.aisles import library, library_bare, supermarket
from vnav.synthetic.furniture import (
    EDGE,
    HEIGHT_M,
    Piece,
    bed,
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
from vnav.synthetic.many_rooms import building, wing
from vnav.synthetic.rearranged import room_after, room_before
from vnav.synthetic.repeating import shop, twin_rooms
from vnav.synthetic.scene import Scene, closed_tour, placed, unlike
from vnav.synthetic.storeys import two_storeys


def apartment(seed: int) -> Scene:
    """A living room, a kitchen and a bedroom, 9 x 6.6 m, joined by three doors to a loop."""
    x1, y1, xm, ym = 9.0, 6.6, 4.8, 3.3
    pieces = [
        *floor_and_ceiling(0, 0, xm, y1, "planks"),
        *floor_and_ceiling(xm, 0, x1, ym, "tiles"),
        *floor_and_ceiling(xm, ym, x1, y1, "planks"),
        *_outer_walls(x1, y1),
        wall((xm, 0), (xm, y1), "wallpaper", doors=(1.6, 5.0)),
        wall((xm, ym), (x1, ym), "plaster", doors=(1.9,)),
        *_living_room(),
        *_kitchen(),
        *_bedroom(),
    ]
    tour = closed_tour(
        (1.7, 1.6, 25),
        (3.3, 1.7, 0),
        (4.8, 1.6, 5),
        (6.0, 1.5, 30),
        (6.7, 2.0, 100),
        (6.7, 3.3, 95),
        (6.7, 4.2, 45),
        (6.9, 4.6, 60),
        (6.4, 4.9, 150),
        (5.7, 5.0, 185),
        (4.8, 5.0, 180),
        (3.4, 5.0, 185),
        (2.2, 4.8, 215),
        (1.4, 3.6, 270),
        (1.2, 2.4, 330),
    )
    return Scene(tuple(pieces), (0, 0, x1, y1, HEIGHT_M), tour, seed)


def one_room(seed: int) -> Scene:
    """A furnished room of 5 x 4.4 m, walked around in a circle while looking across."""
    x1, y1 = 5.0, 4.4
    pieces = [
        *floor_and_ceiling(0, 0, x1, y1, "planks"),
        *_outer_walls(x1, y1),
        placed(sofa(1.9), 0.55, 2.2, 0),
        placed(hung(1.2, 0.8, 1.55, "painting"), EDGE, 2.2, 0),
        placed(shelf(1.1, 5), 4.75, 1.2, 180),
        placed(table(1.2, 0.7), 4.3, 3.2, 180),
        placed(chair(), 3.75, 3.3, 10),
        placed(cupboard(1.2, 0.9), 2.6, 0.32, 90),
        placed(hung(0.7, 0.5, 1.5, "painting"), 2.5, EDGE, 90),
        placed(hung(1.5, 1.1, 1.5, "window"), 2.4, y1 - EDGE, -90),
        placed(hung(0.5, 0.7, 1.6, "painting"), x1 - EDGE, 3.0, 180),
        placed(rug(1.6, 1.1), 2.4, 2.3, 15),
    ]
    angles = np.deg2rad(np.arange(0, 360, 45))
    circle = [
        (2.5 + 0.95 * np.cos(a), 2.2 + 0.85 * np.sin(a), float(np.rad2deg(a)) + 170) for a in angles
    ]
    return Scene(tuple(pieces), (0, 0, x1, y1, HEIGHT_M), closed_tour(*circle), seed)


SCENES: dict[str, Callable[[int], Scene]] = {
    "apartment": apartment,
    "one_room": one_room,
    "twin_rooms": twin_rooms,
    "twin_rooms_unlike": unlike(twin_rooms),
    "shop": shop,
    "shop_unlike": unlike(shop),
    "library": library,
    "library_bare": library_bare,
    "library_unlike": unlike(library),
    "supermarket": supermarket,
    "supermarket_unlike": unlike(supermarket),
    "room_before": room_before,
    "room_after": room_after,
    "two_storeys": two_storeys,
    "building_2": building(2),
    "building_20": building(20),
    **{f"building_10_wing_{room}": wing(10, room) for room in range(10)},
}


def _outer_walls(x1: float, y1: float) -> list[Piece]:
    return [
        wall((0, 0), (x1, 0), "wallpaper"),
        wall((0, y1), (x1, y1), "wallpaper"),
        wall((0, 0), (0, y1), "plaster"),
        wall((x1, 0), (x1, y1), "plaster"),
    ]


def _living_room() -> list[Piece]:
    return [
        placed(sofa(2.1), 2.6, 3.1, -90),
        placed(table(1.0, 0.55, 0.42), 2.6, 2.1, -90),
        placed(shelf(1.6, 6), 0.22, 2.6, 0),
        placed(cupboard(1.6, 0.55), 2.6, 0.32, 90),
        placed(hung(1.3, 0.8, 1.5, "painting"), 2.6, EDGE, 90),
        placed(table(1.5, 0.85), 1.0, 5.8, 90),
        placed(chair(), 1.6, 5.1, 100),
        placed(hung(1.6, 1.2, 1.5, "window"), EDGE, 4.8, 0),
        placed(hung(0.8, 1.0, 1.55, "painting"), 3.2, 6.6 - EDGE, -90),
        placed(cupboard(0.9, 1.3), 4.5, 3.3, 180),
        placed(hung(0.6, 0.6, 1.75, "painting"), 4.8 - EDGE, 3.3, 180),
        placed(rug(2.2, 1.5), 2.6, 1.7, 85),
    ]


def _kitchen() -> list[Piece]:
    return [
        placed(cupboard(2.4, 0.9, 0.6), 7.3, 0.35, 90),
        placed(hung(2.0, 0.6, 1.75, "drawers"), 7.3, EDGE, 90),
        placed(cupboard(0.7, 1.9, 0.65), 5.4, 0.38, 90),
        placed(table(0.9, 0.8), 8.2, 2.1, 180),
        placed(chair(), 7.55, 2.2, 15),
        placed(hung(1.3, 1.1, 1.5, "window"), 9.0 - EDGE, 1.7, 180),
        placed(hung(0.9, 0.6, 1.5, "painting"), 8.2, 3.3 - EDGE, -90),
        placed(shelf(0.7, 3), 5.35, 3.08, -90),
        placed(hung(0.6, 0.45, 1.6, "painting"), 5.4, 3.3 - EDGE, -90),
    ]


def _bedroom() -> list[Piece]:
    return [
        placed(bed(2.0, 1.5), 7.9, 5.75, 180),
        placed(hung(1.0, 0.7, 1.6, "painting"), 9.0 - EDGE, 5.7, 180),
        placed(cupboard(1.4, 2.0, 0.55), 8.2, 3.65, 90),
        placed(cupboard(0.45, 0.5, 0.4), 8.72, 4.7, 180),
        placed(hung(1.4, 1.1, 1.5, "window"), 6.6, 6.6 - EDGE, -90),
        placed(shelf(0.9, 4), 5.4, 6.38, -90),
        placed(hung(0.7, 0.9, 1.5, "painting"), 4.8 + EDGE, 4.0, 0),
        placed(rug(1.7, 1.1), 6.2, 5.2, 95),
    ]
