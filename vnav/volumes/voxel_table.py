"""Voxels, or bricks of voxels, numbered as they are met: a hash table for compiled loops."""

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled

NONE = -1
MULTIPLIER = 0x9E3779B97F4A7C15 - (1 << 64)  # of Fibonacci hashing: Knuth, vol. 3, 6.4
PLACES = 4  # for each key that there is room for: a power of two


VoxelTable = tuple[NDArray[np.int32], NDArray[np.int64], NDArray[np.intp]]  # see `table_for`


def table_for(count: int) -> VoxelTable:
    """A hash table with open addressing, empty, with room for so many keys, a power of two.

    The number at each place, or `NONE`; the key of each number; how many numbers are used, (1,).
    """
    number = np.full(PLACES * count, NONE, np.int32)
    return number, np.empty(count, np.int64), np.zeros(1, np.intp)


def keys_of(table: VoxelTable) -> NDArray[np.int64]:
    """The keys that were met, in that order."""
    _, key, used = table
    return key[: used[0]]


def room_of(table: VoxelTable) -> int:
    """How many keys there is room for."""
    return len(table[1])


def doubled(table: VoxelTable) -> VoxelTable:
    """The same numbers in a table with twice the room."""
    more = table_for(2 * room_of(table))
    _enter(more, keys_of(table))
    return more


@compiled
def _enter(table: VoxelTable, keys: NDArray[np.int64]) -> None:
    for key in keys:
        number_of(table, key)


@compiled
def number_of(table: VoxelTable, key: int) -> int:
    """The number of a key, the next one where it is new; `NONE` where there is no room for it."""
    number, keys, used = table
    last = len(number) - 1
    mixed = key * MULTIPLIER
    place = (mixed ^ mixed >> 32) * MULTIPLIER >> 32 & last  # every bit of the key has a say
    while number[place] != NONE:
        if keys[number[place]] == key:
            return int(number[place])
        place = (place + 1) & last
    new = int(used[0])
    if new == len(keys):
        return NONE
    number[place], keys[new] = new, key
    used[0] += 1
    return new
