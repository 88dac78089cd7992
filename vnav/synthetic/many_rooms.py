"""A building of any number of rooms: how maps and finding a photo fare as they grow."""

from collections.abc import Callable
from dataclasses import replace

from vnav.synthetic.furniture import EDGE, HEIGHT_M, floor_and_ceiling, hung, wall
from vnav.synthetic.repeating import CORRIDOR_M, ROOM_M, furnished_room
from vnav.synthetic.scene import Scene, closed_tour, placed


def building(rooms: int) -> Callable[[int], Scene]:
    """Makes scenes of that many furnished rooms of 4 x 4 m along a corridor, by their seed.

    The rooms are furnished alike, but every face has a look of its own. The tour goes once around
    in each room, then back through the corridor.
    """
    x1, y1 = rooms * ROOM_M, CORRIDOR_M + ROOM_M

    def scene(seed: int) -> Scene:
        pieces = [
            *floor_and_ceiling(0, 0, x1, CORRIDOR_M - EDGE, "tiles"),
            wall((0, 0), (x1, 0), "wallpaper"),
            wall((0, 0), (0, CORRIDOR_M), "plaster"),
            wall((x1, 0), (x1, CORRIDOR_M), "plaster"),
        ]
        for k in range(rooms):
            pieces += furnished_room(k * ROOM_M)
            pieces.append(placed(hung(1.1, 0.8, 1.5, "painting"), (k + 0.4) * ROOM_M, EDGE, 90))
        return Scene(tuple(pieces), (0, 0, x1, y1, HEIGHT_M), _tour(rooms), seed)

    return scene


def wing(rooms: int, room: int) -> Callable[[int], Scene]:
    """The same building as `building`, and a tour of one room of it.

    Once around in the room, along the corridor, and a look through the next room's door. So a
    recording of the next room sees what this one has seen.
    """
    whole = building(rooms)

    def scene(seed: int) -> Scene:
        return replace(whole(seed), tour=_tour_of_wing(rooms, room))

    return scene


AROUND = (  # in by the door, around, and out again: x from the room's wall, y, yaw
    (1.0, 0.9, 20),
    (1.9, 1.2, 80),
    (2.0, 1.9, 90),
    (2.4, 3.2, 60),
    (2.1, 4.0, 150),
    (1.6, 3.9, 240),
    (2.0, 2.6, 300),
    (2.1, 1.7, 290),
    (2.6, 1.0, 345),
)


def _tour(rooms: int) -> tuple[tuple[float, ...], ...]:
    """Into every room, around in it, and out again; back at a corridor's length."""
    stops = [
        (k * ROOM_M + x, y, yaw_deg + 360 * k) for k in range(rooms) for x, y, yaw_deg in AROUND
    ]
    back = 360 * rooms + 180
    stops += [(k * ROOM_M + 2.0, 0.8, back) for k in reversed(range(rooms))]
    return closed_tour(*stops)


def _tour_of_wing(rooms: int, room: int) -> tuple[tuple[float, ...], ...]:
    """Into that room, around, out again; to the next door, if there is one, and back."""
    x0 = room * ROOM_M
    stops: list[tuple[float, ...]] = [(x0 + x, y, yaw_deg) for x, y, yaw_deg in AROUND]
    if room + 1 < rooms:
        stops += [(x0 + ROOM_M + x, y, 360 + yaw_deg) for x, y, yaw_deg in AROUND[:2]]
        stops.append((x0 + ROOM_M + 1.4, 0.8, 540))
    stops.append((x0 + 2.0, 0.8, 540))
    return closed_tour(*stops)
