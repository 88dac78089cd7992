"""A trajectory: poses of the colour camera over time."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import frozen


@dataclass(frozen=True)
class Trajectory:
    """``stamps_s`` (N,) ascending, ``T_world_camera`` (N, 4, 4); N = 0 is legal."""

    stamps_s: NDArray[np.float64]
    T_world_camera: NDArray[np.float64]

    def __post_init__(self) -> None:
        n = len(self.stamps_s)
        object.__setattr__(self, "stamps_s", frozen(self.stamps_s, np.float64, (n,)))
        object.__setattr__(
            self, "T_world_camera", frozen(self.T_world_camera, np.float64, (n, 4, 4))
        )
        if (np.diff(self.stamps_s) <= 0).any():
            raise ValueError("expected ascending time stamps")

    def __len__(self) -> int:
        return len(self.stamps_s)

    @property
    def positions(self) -> NDArray[np.float64]:
        """Camera centres (N, 3) in the world."""
        return self.T_world_camera[:, :3, 3]

    @property
    def length_m(self) -> float:
        """Length of the path through the camera centres."""
        return float(np.linalg.norm(np.diff(self.positions, axis=0), axis=1).sum())
