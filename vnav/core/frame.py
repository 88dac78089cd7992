"""Frames, their features, and the edges between them."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.core import se3
from vnav.core.arrays import frozen
from vnav.core.camera import Intrinsics
from vnav.core.descriptor_space import DescriptorSpace


@dataclass(frozen=True)
class Frame:
    """One colour image and its depth, undistorted and registered.

    Parameters
    ----------
    capture, index
        The frame's key: which capture of the map, which frame of that capture.
    stamp_s
        Time of the colour image.
    color
        (H, W, 3) uint8, RGB.
    depth_m
        (H, W) float32, z in metres, 0 where there is none; see `no_depth`.
    intrinsics
        The pinhole camera of both images, without distortion.
    hidden
        (H, W) bool: pixels that show nothing of the scene, as burnt-in text; they have no depth.
        None where all show it.
    depth_after_s
        How much later than the colour image's the depth image's own time is.
    """

    capture: int
    index: int
    stamp_s: float
    color: NDArray[np.uint8]
    depth_m: NDArray[np.float32]
    intrinsics: Intrinsics
    hidden: NDArray[np.bool_] | None = None
    depth_after_s: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "color", frozen(self.color, np.uint8, (None, None, 3)))
        object.__setattr__(self, "depth_m", frozen(self.depth_m, np.float32, self.color.shape[:2]))
        if self.hidden is not None:
            object.__setattr__(self, "hidden", frozen(self.hidden, bool, self.color.shape[:2]))
        if self.intrinsics.size != self.color.shape[1::-1] or self.intrinsics.distortion:
            raise ValueError(
                f"expected a pinhole camera of {self.color.shape[1::-1]} pixels, found"
                f" {self.intrinsics}"
            )


def no_depth(height: int, width: int) -> NDArray[np.float32]:
    """The depth (H, W) of a frame of which none was measured: 0 everywhere, without memory."""
    return np.broadcast_to(np.float32(0), (height, width))


@dataclass(frozen=True)
class Features:
    """N described keypoints; N = 0 is legal.

    ``keypoints_px`` (N, 2) float32, ``descriptors`` (N, D) as their ``space`` has them, ``scores``
    (N,) float32 response, ``scales_px`` (N,) float32 diameter of the described patch,
    ``angles_rad`` (N,) float32.
    """

    keypoints_px: NDArray[np.float32]
    descriptors: NDArray[Any]
    scores: NDArray[np.float32]
    scales_px: NDArray[np.float32]
    angles_rad: NDArray[np.float32]
    space: DescriptorSpace

    def __post_init__(self) -> None:
        n = len(self.keypoints_px)
        object.__setattr__(self, "keypoints_px", frozen(self.keypoints_px, np.float32, (n, 2)))
        if self.descriptors.dtype != self.space.dtype:
            raise ValueError(
                f"expected descriptors of {self.space}, found {self.descriptors.dtype}"
            )
        described = frozen(self.descriptors, self.space.dtype, (n, self.space.width))
        object.__setattr__(self, "descriptors", described)
        for name in ("scores", "scales_px", "angles_rad"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float32, (n,)))

    def __len__(self) -> int:
        return len(self.keypoints_px)

    def __getitem__(self, selection: NDArray[np.intp] | NDArray[np.bool_]) -> "Features":
        """The selected features, in the order of the selection."""
        return Features(
            self.keypoints_px[selection],
            self.descriptors[selection],
            self.scores[selection],
            self.scales_px[selection],
            self.angles_rad[selection],
            self.space,
        )


@dataclass(frozen=True)
class Edge:
    """A measured transformation between frames i and j (rows of the map's frame table).

    ``information`` (6, 6) is the inverse covariance of the tangent at ``T_i_j``, rotation first.
    ``probability``: that it is the camera's motion, and not that of what repeats or moves.
    """

    i: int
    j: int
    T_i_j: NDArray[np.float64]
    information: NDArray[np.float64]
    probability: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "T_i_j", frozen(self.T_i_j, np.float64, (4, 4)))
        object.__setattr__(self, "information", frozen(self.information, np.float64, (6, 6)))

    def with_added_noise(self, sigma_rad: float, sigma_m: float) -> "Edge":
        """The edge with its covariance grown by the squares of the sigmas."""
        added = np.repeat([sigma_rad**2, sigma_m**2], 3)
        covariance = np.linalg.inv(self.information) + np.diag(added)
        return replace(self, information=np.linalg.inv(covariance))


@dataclass(frozen=True)
class PoseEstimate:
    """How camera b stands to camera a, from matched features.

    ``inliers`` (M, 2): rows of a's and b's features that agree, one of them with depth; ``far``
    (F, 2): those without any; ``information`` and ``probability`` as in `Edge`; ``matches``: of
    both kinds, that were asked.
    """

    T_a_b: NDArray[np.float64]
    information: NDArray[np.float64]
    inliers: NDArray[np.int32]
    matches: int
    probability: float = 1.0
    far: NDArray[np.int32] = field(default_factory=lambda: np.zeros((0, 2), np.int32))

    @property
    def agreeing(self) -> int:
        """How many matches agree, with depth and without."""
        return len(self.inliers) + len(self.far)

    @property
    def inlier_share(self) -> float:
        """Of the matches."""
        return self.agreeing / self.matches

    def fused(self, other: "PoseEstimate") -> "PoseEstimate":
        """The motion that this and another, independent one tell together, by their information."""
        information = self.information + other.information
        off = se3.deviation(se3.inverse(self.T_a_b) @ other.T_a_b)
        T_a_b = self.T_a_b @ se3.exp(np.linalg.solve(information, other.information @ off))
        return replace(self, T_a_b=T_a_b, information=information)


@dataclass(frozen=True)
class Rejected:
    """No answer, and why. ``matches`` and ``inliers`` say how far it came."""

    reason: str
    matches: int = 0
    inliers: int = 0
