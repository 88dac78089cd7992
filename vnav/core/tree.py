"""The vocabulary tree as a value: nodes, and the words of descriptors."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Floats, frozen
from vnav.core.descriptor_space import DescriptorSpace

CHUNK = 512  # descriptors quantised at once, so that their candidate centres stay in the cache


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
    """

    centres: NDArray[Any]
    first_child: NDArray[np.int32]
    children: NDArray[np.int32]
    level: NDArray[np.int32]
    space: DescriptorSpace

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

    def clamped(self, level: int) -> int:
        """The level that is asked for, or the nearest that exists."""
        return min(max(level, 0), self.levels)

    @cached_property
    def _float_centres(self) -> tuple[Floats, Floats]:
        centres = self.space.vectors(self.centres)
        return centres, np.einsum("ij,ij->i", centres, centres) / 2

    def quantise(self, descriptors: NDArray[Any]) -> NDArray[np.int32]:
        """Nodes (N, levels + 1) on the way of descriptors (N, D) from the root to a leaf.

        A leaf above the deepest level repeats itself; no descriptors give no rows (claim 4, 2.2).
        """
        paths = np.zeros((len(descriptors), self.levels + 1), np.int32)
        for start in range(0, len(paths), CHUNK):
            rows = slice(start, start + CHUNK)
            self._descend(self.space.vectors(descriptors[rows]), paths[rows])
        return paths

    def _descend(
        self,
        descriptors: Floats,
        paths: NDArray[np.int32],
    ) -> None:
        """Fill the paths of one chunk, level by level; sums over bytes and bits are exact."""
        centres, half_norm = self._float_centres
        slots = np.arange(self.children.max())
        for level in range(self.levels):
            node = paths[:, level]
            paths[:, level + 1] = node
            inner = np.flatnonzero(self.children[node])
            node = node[inner]
            absent = slots >= self.children[node, None]
            child = np.where(absent, 0, self.first_child[node, None] + slots)
            gain = np.matmul(centres.take(child, 0), descriptors[inner, :, None])[..., 0]
            gain -= half_norm[child]
            gain[absent] = -np.inf
            best = gain.argmax(1)
            paths[inner, level + 1] = child[np.arange(len(best)), best]

    def to_arrays(self) -> dict[str, NDArray[Any]]:
        """What must be stored to get the tree back."""
        return {
            "centres": self.centres,
            "first_child": self.first_child,
            "children": self.children,
            "level": self.level,
        }
