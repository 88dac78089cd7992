"""The index of a map and its vocabulary tree: what photos are searched in."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Rows
from vnav.core.map_index import MapIndex, rows_of
from vnav.core.tree import VocabularyTree
from vnav.localisation.inverted_file import InvertedFile

SAME_POINT_M = 0.10  # landmarks nearer than this may be one and the same point, mapped twice


@dataclass(frozen=True)
class LandmarkDatabase:
    """What a photo is searched in."""

    index: MapIndex
    tree: VocabularyTree

    @cached_property
    def inverted_file(self) -> InvertedFile:
        """The landmarks' descriptors and where the landmarks are."""
        i = self.index
        return InvertedFile(i.descriptors, i.points_world[i.owner], SAME_POINT_M, self.tree.space)

    @cached_property
    def reference_keyframe(self) -> NDArray[np.int32]:
        """The first keyframe (L,) that saw each landmark."""
        return self.index.seen_by[self.index.seen_start[:-1]]

    def words(self, rows: Rows, level: int) -> NDArray[np.int32]:
        """Nodes at a level of the tree, from the root, of some rows of descriptors."""
        if level not in self._words:
            is_leaf = self.tree.children == 0
            at_level = (self.tree.level == level) | ((self.tree.level < level) & is_leaf)
            first, last = self.index.span.T
            nodes = np.flatnonzero(at_level & (last > first))
            nodes = nodes[np.argsort(first[nodes])]
            self._words[level] = np.repeat(nodes, (last - first)[nodes]).astype(np.int32)
        return self._words[level][rows]

    @cached_property
    def _words(self) -> dict[int, NDArray[np.int32]]:
        """The node of every row, by level; made when first asked for."""
        return {}

    def rows_of(self, landmarks: NDArray[np.int32] | Rows) -> Rows:
        """Rows of the landmarks' descriptors, ascending; no landmark twice."""
        described = self.index.described[rows_of(self.index.described_start, landmarks)[1]]
        return np.sort(described).astype(np.intp)
