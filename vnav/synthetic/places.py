"""Where people can stand and sit in a scene."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vnav.core.grid import FREE, Grid
from vnav.synthetic.scene import Box, Scene

Array = NDArray[np.float64]
NET_M = 0.28
MOVES = np.array(  # nodes along y and x in one step of half a second: 0.56 to 1.25 m/s
    [(y, x) for y in range(-2, 3) for x in range(-2, 3) if 0 < x * x + y * y < 6]
)
GRID_M = 0.05
CLEARANCE_M = 0.25  # from the middle of a body to what stands around
BODY_M = 0.05, 1.9  # heights that it takes
SEAT_M = 0.38, 0.52  # heights to sit on
FEET_M = 0.2, 0.5  # in front of a seat's edge, where somebody may stand who wants to sit down
SEATED_FEET_M = 0.28


@dataclass(frozen=True)
class Net:
    """Where a body may stand.

    ``xy`` (R, C, 2) metres; ``free`` (R, C); ``reached`` (M, R, C): whether the straight way of
    each of MOVES into a node is free; ``seats`` (R, C, 3): x, y, yaw of the feet of who sits down
    from a node, NaN where there is no seat.
    """

    xy: Array
    free: NDArray[np.bool_]
    reached: NDArray[np.bool_]
    seats: Array


def net_of(scene: Scene) -> Net:
    """The net of a scene; CLEARANCE_M from all that stands in it."""
    net = net_on(scene.grid(GRID_M, *BODY_M), scene.bounds)
    return replace(net, seats=_seats(scene, net.xy))


def net_on(grid: Grid, bounds: Sequence[float]) -> Net:
    """A net without seats within x0, y0, x1, y1, CLEARANCE_M from what is not free in a grid."""
    free = (grid.cells == FREE).astype(np.uint8)
    room = cv2.distanceTransform(free, cv2.DIST_L2, 5) * grid.resolution_m
    x0, y0, x1, y1 = bounds[:4]
    x, y = np.arange(x0, x1, NET_M) + NET_M / 2, np.arange(y0, y1, NET_M) + NET_M / 2
    xy = np.stack(np.meshgrid(x, y), -1)

    def clear(points: Array) -> NDArray[np.bool_]:
        cells = np.clip(grid.cells_at(points), 0, np.array(room.shape) - 1)
        return np.asarray(room[cells[..., 0], cells[..., 1]] > CLEARANCE_M)

    back = -NET_M * MOVES[:, None, None, ::-1]
    along = [clear(xy + share * back) for share in np.linspace(0, 1, 6)]
    return Net(xy, clear(xy), np.all(along, 0), np.full((*xy.shape[:2], 3), np.nan))


def _seats(scene: Scene, xy: Array) -> Array:
    found = np.full((*xy.shape[:2], 3), np.nan)
    for box in (box for piece in scene.pieces for box in piece):
        top = box.centre[2] + box.size[2] / 2
        if SEAT_M[0] < top < SEAT_M[1] and min(box.size[:2]) > 0.3:
            own = (xy - box.centre[:2]) @ box.R_world_box[:2, :2]
            ahead = own[..., 0] - box.size[0] / 2
            beside = np.abs(own[..., 1]) < box.size[1] / 2 - 0.15
            here = (ahead > FEET_M[0]) & (ahead < FEET_M[1]) & beside
            found[here] = _feet(box, own[here])
    return found


def _feet(box: Box, own: Array) -> Array:
    """x, y, yaw (N, 3) of who sits on a box, from where they stand in the box's frame (N, 2)."""
    feet = np.column_stack([np.full(len(own), box.size[0] / 2 + SEATED_FEET_M), own[:, 1]])
    at = feet @ box.R_world_box[:2, :2].T + box.centre[:2]
    return np.column_stack([at, np.full(len(own), box.yaw_rad)])
