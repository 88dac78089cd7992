"""The vocabulary tree as a value: nodes, and the words of descriptors."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.compiled.descent import descend
from vnav.core.arrays import Floats, frozen
from vnav.core.descriptor_space import DescriptorSpace
from vnav.core.map_index import ranges

CHUNK = 512  # descriptors quantised at once, so that their candidate centres stay in the cache
FINEST = -1  # the level of the leaves, however deep the tree is


@dataclass(frozen=True)
class VocabularyTree:
    """A hierarchical k-means tree; node 0 is the root, and a node's children lie side by side.

    Parameters
    ----------
    centres
        (nodes, D) descriptors of the ``space``; the root's means nothing.
    first_child, children
        (nodes,) int32: number of the first child and how many; 0 children: a leaf.
    level
        (nodes,) int32, root = 0.
    paths_followed
        Of each level so many nodes are followed to the nearest leaf: 1 for a tree whose nodes are
        split one by one, more for leaves that were clustered first.
    """

    centres: NDArray[Any]
    first_child: NDArray[np.int32]
    children: NDArray[np.int32]
    level: NDArray[np.int32]
    space: DescriptorSpace
    paths_followed: int = 1

    def __post_init__(self) -> None:
        n = len(self.centres)
        object.__setattr__(
            self, "centres", frozen(self.centres, self.space.dtype, (n, self.space.width))
        )
        for name in ("first_child", "children", "level"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.int32, (n,)))

    @property
    def levels(self) -> int:
        """Deepest level; 0 where the root is the only node."""
        return int(self.level[-1])

    @property
    def words(self) -> int:
        """Number of leaves."""
        return int((self.children == 0).sum())

    def from_root(self, level: int, counted_from: str) -> int:
        """A level as counted from the root, where it is counted from the "root" or the "leaves".

        The deepest leaves are level 0 of those counted from the leaves. `FINEST` is theirs in
        either case. The tree need not have the level.
        """
        if level == FINEST:
            return self.levels
        return level if counted_from == "root" else self.levels - level

    def clamped(self, level: int) -> int:
        """A level counted from the root, or the nearest that exists."""
        return min(max(level, 0), self.levels)

    @cached_property
    def _float_centres(self) -> tuple[Floats, Floats]:
        centres = self.space.vectors(self.centres)
        return centres, np.einsum("ij,ij->i", centres, centres) / 2

    def quantise(self, descriptors: NDArray[Any]) -> NDArray[np.int32]:
        """Nodes (N, levels + 1) on the way of descriptors (N, D) from the root to a leaf.

        A leaf above the deepest level repeats itself; no descriptors give no rows (claim 4, 2.2).
        """
        if self.paths_followed > 1:
            return self._paths_to(self.nearest_leaves(descriptors, self.paths_followed)[:, 0])
        centres, asked = map(self.space.comparable, (self.centres, descriptors))
        paths = np.zeros((len(asked), self.levels + 1), np.int32)
        descend(asked, centres, self.first_child, self.children, paths)
        return paths

    def nearest_leaves(self, descriptors: NDArray[Any], count: int) -> NDArray[np.int32]:
        """At most ``count`` leaves (N, count) near descriptors (N, D), the nearest first, else -1.

        Greedy N-best paths (Schindler, Brown, Szeliski 2007): of each level the nearest nodes are
        followed.
        """
        found = np.full((len(descriptors), count), -1, np.int32)
        for start in range(0, len(found), CHUNK // count + 1):
            rows = slice(start, start + CHUNK // count + 1)
            nodes = self._best_nodes(self.space.vectors(descriptors[rows]), count)
            found[rows, : nodes.shape[1]] = nodes
        return found

    def _paths_to(self, leaves: NDArray[np.int32]) -> NDArray[np.int32]:
        """The nodes (N, levels + 1) from the root to leaves (N,)."""
        inner = np.flatnonzero(self.children)
        parent = np.zeros(len(self.level), np.int32)
        first = self.first_child[inner]
        which, child = ranges(first, first + self.children[inner])
        parent[child] = inner[which]
        paths = np.repeat(leaves[:, None], self.levels + 1, 1)
        for level in range(self.levels - 1, -1, -1):
            node = paths[:, level + 1]
            paths[:, level] = np.where(self.level[node] > level, parent[node], node)
        return paths

    def _best_nodes(self, descriptors: Floats, count: int) -> NDArray[np.int32]:
        """The same for one chunk, with as many columns as there are leaves to be told."""
        centres, half_norm = self._float_centres
        nodes, slots = np.zeros((len(descriptors), 1), np.int32), np.arange(self.children.max())
        for _ in range(self.levels):
            inner = self.children[nodes, None] > 0
            below = np.where(inner, self.first_child[nodes, None] + slots, nodes[:, :, None])
            absent = slots >= np.maximum(self.children[nodes, None], 1)
            absent |= (nodes < 0)[:, :, None]
            below, absent = (part.reshape(len(nodes), -1) for part in (below, absent))
            below = np.where(absent, 0, below)
            gain = np.matmul(centres.take(below, 0), descriptors[:, :, None])[..., 0]
            gain -= half_norm[below]
            gain[absent] = -np.inf
            best = np.argsort(-gain, 1, kind="stable")[:, :count]
            nodes = np.take_along_axis(np.where(absent, -1, below), best, 1).astype(np.int32)
        return nodes

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """What must be stored to get the tree back."""
        arrays = {
            "centres": self.centres,
            "first_child": self.first_child,
            "children": self.children,
            "level": self.level,
        }
        if self.paths_followed > 1:
            arrays["paths_followed"] = np.array(self.paths_followed, np.int32)
        return arrays
