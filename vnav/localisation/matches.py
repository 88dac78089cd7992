"""Matches between a photo's features and rows of the map's index."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Rows


@dataclass(frozen=True)
class Matches:
    """Feature, index row and landmark that belong together, all (M,).

    ``cost`` (M,) float32: what makes one match better than another, the smaller the better.
    """

    feature: Rows
    row: Rows
    landmark: NDArray[np.int32]
    cost: NDArray[np.float32]

    def __len__(self) -> int:
        return len(self.feature)

    def __getitem__(self, chosen: Rows | NDArray[np.bool_]) -> "Matches":
        return Matches(
            self.feature[chosen], self.row[chosen], self.landmark[chosen], self.cost[chosen]
        )

    def joined(self, other: "Matches") -> "Matches":
        """These, then the others."""
        return Matches(
            np.concatenate([self.feature, other.feature]),
            np.concatenate([self.row, other.row]),
            np.concatenate([self.landmark, other.landmark]),
            np.concatenate([self.cost, other.cost]),
        )

    def one_to_one(self) -> "Matches":
        """Each feature and each landmark once, the better match first; best first."""
        best_first = self[np.argsort(self.cost, kind="stable")]
        once = best_first[_first_of_each(best_first.feature)]
        return once[_first_of_each(once.landmark)]


def no_matches() -> Matches:
    """None at all."""
    none = np.zeros(0, np.intp)
    return Matches(none, none, none.astype(np.int32), none.astype(np.float32))


def _first_of_each(values: NDArray[np.intp] | NDArray[np.int32]) -> Rows:
    return np.sort(np.unique(values, return_index=True)[1])
