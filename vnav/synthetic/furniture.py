"""Furniture and walls as boxes; furniture stands on z = 0 about its own origin and faces +x."""

import numpy as np

from vnav.synthetic.scene import Box

WALL_M = 0.10
EDGE = WALL_M / 2  # from the middle of a wall to its face
HEIGHT_M = 2.5
DOOR_M = 2.05

Piece = tuple[Box, ...]


def block(
    x: float, y: float, z: float, size: tuple[float, float, float], material: str, front: str = ""
) -> Box:
    """A box whose middle is at x, y and whose bottom is at z."""
    return Box((x, y, z + size[2] / 2), size, 0.0, material, front)


def table(length: float, width: float, height: float = 0.74) -> list[Box]:
    """A table, its length along y."""
    x, y = width / 2 - 0.06, length / 2 - 0.06
    legs = [(sx * x, sy * y) for sx in (-1, 1) for sy in (-1, 1)]
    top = block(0, 0, height - 0.05, (width, length, 0.05), "wood")
    return [top, *(block(*leg, 0, (0.06, 0.06, height - 0.05), "wood") for leg in legs)]


def chair() -> list[Box]:
    """A chair, its back behind."""
    back = block(-0.2, 0, 0.45, (0.04, 0.42, 0.45), "fabric")
    return [*table(0.42, 0.42, 0.45), back]


def sofa(length: float) -> list[Box]:
    """A sofa with arms and cushions of its own."""
    arms = [block(0, s * (length / 2 - 0.1), 0, (0.85, 0.2, 0.6), "fabric") for s in (-1, 1)]
    back = block(-0.35, 0, 0.42, (0.18, length - 0.4, 0.42), "fabric")
    cushion = block(-0.2, length / 5, 0.42, (0.14, 0.45, 0.4), "fabric")
    return [block(0, 0, 0, (0.85, length - 0.4, 0.42), "fabric"), *arms, back, cushion]


def bed(length: float, width: float) -> list[Box]:
    """A bed, its head behind."""
    mattress = block(0, 0, 0.25, (length, width, 0.22), "fabric")
    head = block(-length / 2 - 0.03, 0, 0, (0.06, width + 0.1, 1.0), "wood")
    pillows = [
        block(-length / 2 + 0.25, s * width / 4, 0.47, (0.4, 0.55, 0.12), "linen") for s in (-1, 1)
    ]
    return [block(0, 0, 0, (length, width, 0.25), "wood"), mattress, head, *pillows]


def shelf(width: float, rows: int, depth: float = 0.3) -> list[Box]:
    """Rows of books between boards."""
    pitch = 0.36
    boards = [block(0, 0, k * pitch, (depth, width, 0.03), "wood") for k in range(rows + 1)]
    books = [
        block(
            -0.04, 0, k * pitch + 0.03, (depth - 0.08, width - 0.06, pitch - 0.03), "wood", "books"
        )
        for k in range(rows)
    ]
    sides = [
        block(0, s * (width / 2 + 0.015), 0, (depth, 0.03, rows * pitch + 0.03), "wood")
        for s in (-1, 1)
    ]
    return [*boards, *books, *sides]


def cupboard(width: float, height: float, depth: float = 0.5) -> list[Box]:
    """A box with doors or drawers in front."""
    return [block(0, 0, 0, (depth, width, height), "wood", "drawers")]


def hung(width: float, height: float, middle_m: float, front: str) -> list[Box]:
    """A picture, window or hanging cupboard, its back on a wall at the origin."""
    depth = 0.3 if front == "drawers" else 0.03
    return [block(depth / 2, 0, middle_m - height / 2, (depth, width, height), "wood", front)]


def rug(length: float, width: float) -> list[Box]:
    """A rug, its length along y."""
    return [block(0, 0, 0, (width, length, 0.008), "fabric")]


def wall(
    start: tuple[float, float],
    end: tuple[float, float],
    material: str,
    doors: tuple[float, ...] = (),
) -> tuple[Box, ...]:
    """A wall whose middle runs from start to end, doors of 0.9 m at distances from the start."""
    a, b = np.array(start), np.array(end)
    length, yaw = float(np.hypot(*(b - a))), float(np.arctan2(*(b - a)[::-1]))
    cuts = [0.0, *(d + s * 0.45 for d in doors for s in (-1, 1)), length]
    pieces = [(cuts[k], cuts[k + 1], 0.0) for k in range(0, len(cuts), 2)]
    pieces += [(d - 0.45, d + 0.45, DOOR_M) for d in doors]
    boxes = []
    for near, far, bottom in pieces:
        x, y = a + (b - a) / length * (near + far) / 2
        size = (far - near, WALL_M, HEIGHT_M - bottom)
        boxes.append(Box((float(x), float(y), (HEIGHT_M + bottom) / 2), size, yaw, material))
    return tuple(boxes)


def floor_and_ceiling(x0: float, y0: float, x1: float, y1: float, floor: str) -> list[tuple[Box]]:
    """Below and above a room."""
    size = (x1 - x0, y1 - y0, 0.1)
    x, y = (x0 + x1) / 2, (y0 + y1) / 2
    return [(block(x, y, -0.1, size, floor),), (block(x, y, HEIGHT_M, size, "plaster"),)]
