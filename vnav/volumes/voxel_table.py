"""Voxels, or bricks of voxels, numbered as they are met: a hash table for compiled loops."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled

NONE = -1
MULTIPLIER = 0x9E3779B97F4A7C15 - (1 << 64)  # of Fibonacci hashing: Knuth, vol. 3, 6.4
PLACES = 4  # for each key that there is room for: a power of two


class VoxelTable(NamedTuple):
    """A hash table with open addressing.

    ``number`` (P,) int32: the number at each place, or `NONE`; ``key`` (N,) int64 of each number;
    ``used`` (1,): how many numbers there are.
    """

    number: NDArray[np.int32]
    key: NDArray[np.int64]
    used: NDArray[np.intp]

    @property
    def keys(self) -> NDArray[np.int64]:
        """The keys that were met, in that order."""
        return self.key[: self.used[0]]


def table_for(count: int) -> VoxelTable:
    """An empty table with room for so many keys, a power of two."""
    number = np.full(PLACES * count, NONE, np.int32)
    return VoxelTable(number, np.empty(count, np.int64), np.zeros(1, np.intp))


def doubled(table: VoxelTable) -> VoxelTable:
    """The same numbers in a table with twice the room."""
    more = table_for(2 * len(table.key))
    _enter(more, table.keys)
    return more


@compiled
def _enter(table: VoxelTable, keys: NDArray[np.int64]) -> None:
    for key in keys:
        number_of(table, key)


@compiled
def number_of(table: VoxelTable, key: int) -> int:
    """The number of a key, the next one where it is new; `NONE` where there is no room for it."""
    last = len(table.number) - 1
    mixed = key * MULTIPLIER
    place = (mixed ^ mixed >> 32) * MULTIPLIER >> 32 & last  # every bit of the key has a say
    while table.number[place] != NONE:
        if table.key[table.number[place]] == key:
            return int(table.number[place])
        place = (place + 1) & last
    used = table.used[0]
    if used == len(table.key):
        return NONE
    table.number[place], table.key[used] = used, key
    table.used[0] += 1
    return int(used)
