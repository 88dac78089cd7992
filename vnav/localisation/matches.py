"""Matches between a photo's features and the map's landmarks: as rows, and as coordinates."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array, Rows


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


@dataclass(frozen=True)
class Correspondences2D3D:
    """Points (N, 3) of the map, the pixels (N, 2) they are seen at, and the variance (N,) of both.

    ``variance_px2`` adds the keypoint's noise and the projected noise of the landmark.
    """

    points_world: NDArray[np.float32]
    px: NDArray[np.float32]
    variance_px2: Array

    def __getitem__(self, chosen: NDArray[np.bool_]) -> "Correspondences2D3D":
        """The chosen rows."""
        return Correspondences2D3D(
            self.points_world[chosen], self.px[chosen], self.variance_px2[chosen]
        )


def no_matches() -> Matches:
    """None at all."""
    none = np.zeros(0, np.intp)
    return Matches(none, none, none.astype(np.int32), none.astype(np.float32))


def _first_of_each(values: NDArray[np.intp] | NDArray[np.int32]) -> Rows:
    return np.sort(np.unique(values, return_index=True)[1])
