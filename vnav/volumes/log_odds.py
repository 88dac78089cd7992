"""Log-odds of voxels, summed over scans exactly as OctoMap sums them, in compiled code.

Source: Hornung et al., OctoMap, 2013, and the library's ``insertPointCloud``: rays are walked as by
Amanatides and Woo 1987, with the same 32-bit and 64-bit sums, so that the same voxels are found.
The library walks them one point at a time into a hash set, and holds Python's lock meanwhile.
Here a voxel remembers the last scan that changed it, which makes sets needless.
"""

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.volumes.voxel_table import (
    NONE,
    VoxelTable,
    doubled,
    keys_of,
    number_of,
    room_of,
    table_for,
)

KEYS = 1 << 16  # of voxels along an axis; the world's origin is at the middle
BRICK = 8  # voxels along the edge of a brick, in which voxels are stored
BRICK_VOXELS = BRICK**3
BRICKS = 256  # room to begin with
SPREAD = np.array([0, 1, 8, 9, 64, 65, 72, 73])  # three bits, with room for two more between them
Key = tuple[int, int, int]
Odds = tuple[np.float32, np.float32, np.float32, np.float32]  # see `VoxelLogOdds`
Bricks = tuple[VoxelTable, NDArray[np.float32], NDArray[np.int32]]  # see `_bricks_in`


class VoxelLogOdds:
    """How likely each voxel of ``resolution_m`` is occupied, by all scans.

    ``odds``: the log-odds that a hit and a miss add, the least and the most that their sum may be.
    """

    def __init__(self, resolution_m: float, odds: Odds) -> None:
        self._resolution_m, self._odds = resolution_m, odds
        self._bricks, self._scans = _bricks_in(table_for(BRICKS)), 0

    def insert(
        self, points_world: NDArray[np.floating], sensor_world: NDArray[np.floating]
    ) -> None:
        """Add one scan: its points (N, 3), and the sensor (3,) that all its rays start from.

        Each voxel that holds a point is hit once; each other that a ray crosses is missed once. A
        ray that leaves the `KEYS` voxels of an axis is left out.
        """
        points, sensor = points_world.astype(np.float32), sensor_world.astype(np.float32)
        self._scans += 1
        while not _insert(
            self._bricks, self._scans, points, sensor, self._resolution_m, self._odds
        ):
            self._bricks = _with_more_room(self._bricks)

    def known(self) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """Morton codes (V,), ascending, of all voxels that a scan changed, and their log-odds."""
        table, log_odds, scan = self._bricks
        code = _morton(keys_of(table))
        order = np.argsort(code)
        brick, voxel = np.nonzero(scan[order])
        return code[order[brick]] * BRICK_VOXELS + voxel, log_odds[order[brick], voxel]


def _bricks_in(table: VoxelTable) -> Bricks:
    """Bricks (B) by the keys of their corners; the system gives memory to those that are used.

    With a table of their numbers: (B, 512) float32, the log-odds of their voxels in Morton order,
    and (B, 512) int32, the last scan that changed each voxel, 0 where none did. Loops ask for them
    by place: unpacked, they would be counted as used at each step, which takes thrice the time.
    """
    shape = room_of(table), BRICK_VOXELS
    return table, np.zeros(shape, np.float32), np.zeros(shape, np.int32)


def _with_more_room(bricks: Bricks) -> Bricks:
    table, log_odds, scan = bricks
    more = _bricks_in(doubled(table))
    more[1][: len(log_odds)], more[2][: len(scan)] = log_odds, scan
    return more


def _morton(corner: NDArray[np.int64]) -> NDArray[np.int64]:
    """The bits of a brick's three coordinates in turn, x lowest: order of an octree's leaves."""
    code = np.zeros_like(corner)
    for bit in range(13):
        for axis in range(3):
            code |= (corner >> (16 * axis + bit) & 1) << (3 * bit + axis)
    return code


@compiled
def _insert(
    bricks: Bricks,
    scan: int,
    points: NDArray[np.float32],
    sensor: NDArray[np.float32],
    resolution_m: float,
    odds: Odds,
) -> bool:
    """Hit the voxels of points, then miss what their rays cross; False where room is wanting.

    What a scan changed it does not change again, so it may be inserted again when there is room.
    """
    start = _key(sensor, resolution_m)
    for n in range(len(points)):
        x, y, z = _key(points[n], resolution_m)
        if x == NONE:
            continue
        brick = number_of(bricks[0], _corner(x, y, z))
        if brick == NONE:
            return False
        _update(bricks, (brick, _voxel(x, y, z)), scan, odds[0], odds)
    for n in range(len(points)):
        end = _key(points[n], resolution_m)
        if start[0] == NONE or end[0] == NONE or start == end:
            continue
        if not _miss_between(bricks, scan, (start, end), (sensor, points[n]), resolution_m, odds):
            return False
    return True


@compiled
def _miss_between(
    bricks: Bricks,
    scan: int,
    keys: tuple[Key, Key],
    ends: tuple[NDArray[np.float32], NDArray[np.float32]],
    resolution_m: float,
    odds: Odds,
) -> bool:
    """Miss what a ray crosses from its first voxel to the one before its last; as `_insert`."""
    (x, y, z), last = keys
    (x0, y0, z0), (x1, y1, z1) = ends
    dx, dy, dz = x1 - x0, y1 - y0, z1 - z0
    length = np.float32(np.sqrt(np.float64(dx * dx + dy * dy + dz * dz)))
    step_x, next_x, delta_x = _borders(x, x0, dx / length, resolution_m)
    step_y, next_y, delta_y = _borders(y, y0, dy / length, resolution_m)
    step_z, next_z, delta_z = _borders(z, z0, dz / length, resolution_m)
    corner, brick = NONE, NONE
    while True:
        if corner != _corner(x, y, z):
            corner = _corner(x, y, z)
            brick = number_of(bricks[0], corner)
            if brick == NONE:
                return False
        _update(bricks, (brick, _voxel(x, y, z)), scan, odds[1], odds)
        if next_x < next_y and next_x < next_z:
            x, next_x = (x + step_x) % KEYS, next_x + delta_x
        elif next_x >= next_y and next_y < next_z:
            y, next_y = (y + step_y) % KEYS, next_y + delta_y
        else:
            z, next_z = (z + step_z) % KEYS, next_z + delta_z
        if (x, y, z) == last or min(next_x, next_y, next_z) > length:
            return True


@compiled
def _borders(
    key: int, start: np.float32, direction: np.float32, resolution_m: float
) -> tuple[int, float, float]:
    """Along an axis: the way a ray goes, how far its next border is, and all others from there."""
    if direction == 0:
        return 0, np.inf, np.inf
    step = 1 if direction > 0 else -1
    border = (key - KEYS // 2 + 0.5) * resolution_m + np.float64(
        np.float32(step * resolution_m * 0.5)
    )
    return step, (border - start) / direction, resolution_m / abs(np.float64(direction))


@compiled
def _update(
    bricks: Bricks, voxel: tuple[int, int], scan: int, change: np.float32, odds: Odds
) -> None:
    """Change a voxel of a brick that this scan has not changed yet."""
    if bricks[2][voxel] != scan:
        bricks[2][voxel] = scan
        total = np.float32(bricks[1][voxel] + change)
        bricks[1][voxel] = min(max(total, odds[2]), odds[3])


@compiled
def _key(point: NDArray[np.float32], resolution_m: float) -> Key:
    """The voxel of a point, counted along each axis; `NONE` for all where there is none."""
    inverse = 1 / resolution_m
    x = np.int64(np.floor(inverse * point[0])) + KEYS // 2
    y = np.int64(np.floor(inverse * point[1])) + KEYS // 2
    z = np.int64(np.floor(inverse * point[2])) + KEYS // 2
    if min(x, y, z) < 0 or max(x, y, z) >= KEYS:
        return NONE, NONE, NONE
    return int(x), int(y), int(z)


@compiled
def _corner(x: int, y: int, z: int) -> int:
    """The key of a voxel's brick."""
    return z // BRICK << 32 | y // BRICK << 16 | x // BRICK


@compiled
def _voxel(x: int, y: int, z: int) -> int:
    """A voxel's number within its brick: the bits of its coordinates in turn, x lowest."""
    return int(SPREAD[x % BRICK] | SPREAD[y % BRICK] << 1 | SPREAD[z % BRICK] << 2)
