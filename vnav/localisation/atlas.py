"""The index of a map and its vocabulary tree, ready for questions."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vnav.core.map_index import MapIndex
from vnav.core.tree import VocabularyTree
from vnav.localisation.words import Database

Rows = NDArray[np.intp]

APART_M = 0.10  # landmarks nearer than this may be one and the same thing, mapped twice


@dataclass(frozen=True)
class Atlas:
    """What a photo is searched in."""

    index: MapIndex
    tree: VocabularyTree

    @cached_property
    def database(self) -> Database:
        """The landmarks' descriptors and where the landmarks are."""
        i = self.index
        return Database(i.descriptors, i.half_norm, i.points_world[i.owner], APART_M)

    @cached_property
    def home(self) -> NDArray[np.int32]:
        """A keyframe (L,) that saw each landmark."""
        return self.index.seen_by[self.index.seen_start[:-1]]

    def words(self, rows: Rows, level: int) -> NDArray[np.int32]:
        """Nodes at a level of the tree (clamped to it) of some rows of descriptors."""
        level = self.tree.clamped(level)
        is_leaf = self.tree.children == 0
        at_level = (self.tree.level == level) | ((self.tree.level < level) & is_leaf)
        nodes = np.flatnonzero(at_level & (self.index.span[:, 1] > self.index.span[:, 0]))
        nodes = nodes[np.argsort(self.index.span[nodes, 0])]
        place = np.searchsorted(self.index.span[nodes, 0], rows, "right") - 1
        return nodes[place].astype(np.int32)

    def rows_of(self, landmarks: NDArray[np.int32]) -> Rows:
        """Rows of the landmarks' descriptors, ascending."""
        wanted = np.zeros(len(self.index.points_world), bool)
        wanted[landmarks] = True
        return np.flatnonzero(wanted[self.index.owner])
