"""What the descriptors of a front-end are, how far apart two are, and what their mean is."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.core.arrays import Array, Floats

BITS_AT_ONCE = 64  # that compiled loops compare


@dataclass(frozen=True)
class DescriptorSpace:
    """How the descriptors of a front-end are compared; nothing else knows.

    Parameters
    ----------
    front_end
        The front-end's name: those of two front-ends have nothing in common.
    dtype, width
        ``uint8`` or ``float32``, and entries of a descriptor.
    metric
        ``l2``: Euclidean; ``hamming``: differing bits, of which each byte holds eight.
    typical
        How far apart descriptors of unlike things typically are: settings count in it.
    has_angles, has_scales
        Whether a keypoint's orientation, its size, is that of what it shows.
    """

    front_end: str
    dtype: str
    width: int
    metric: str
    typical: float
    has_angles: bool = True
    has_scales: bool = True

    def __post_init__(self) -> None:
        if self.dtype not in ("uint8", "float32") or self.metric not in ("l2", "hamming"):
            raise ValueError(f"expected a known type and metric of descriptors, found {self}")
        if self.packed and (self.dtype != "uint8" or 8 * self.width % BITS_AT_ONCE):
            raise ValueError(f"expected bits in bytes, a multiple of {BITS_AT_ONCE}, found {self}")

    @property
    def packed(self) -> bool:
        """Whether a byte holds eight entries of a binary vector."""
        return self.metric == "hamming"

    @property
    def size(self) -> int:
        """Bytes of a descriptor."""
        return self.width * np.dtype(self.dtype).itemsize

    def none(self) -> NDArray[Any]:
        """No descriptors (0, D)."""
        return np.zeros((0, self.width), self.dtype)

    def vectors(self, descriptors: NDArray[Any]) -> Floats:
        """Descriptors (N, D) as vectors (N, V).

        Their squared Euclidean distance is `squared` of the distance: of bits it counts those
        that differ.
        """
        if self.packed:
            return np.unpackbits(descriptors, axis=1).astype(np.float32)
        return descriptors.astype(np.float32)

    def nearest(self, vectors: Array | Floats) -> NDArray[Any]:
        """The descriptors (N, D) nearest to vectors (N, V): of a mean of bits their majority."""
        if self.packed:
            return np.packbits(vectors > 0.5, axis=1)
        if self.dtype == "uint8":
            return np.rint(vectors).clip(0, 255).astype(np.uint8)
        return vectors.astype(np.float32)

    def comparable(self, descriptors: NDArray[Any]) -> NDArray[Any]:
        """Descriptors (N, D) as `vnav.compiled.descriptors.squared_distance` takes them."""
        if self.packed:
            return np.ascontiguousarray(descriptors).view(np.uint64)
        return descriptors

    def squared(self, distance: float) -> float:
        """The square of a Euclidean distance, or of a ratio of two.

        A count of bits is one already, for it is a squared distance of binary vectors.
        """
        return distance if self.packed else distance**2

    def distance(self, squared: Floats) -> Floats:
        """The inverse of `squared`."""
        return squared if self.packed else np.sqrt(squared)


UNDESCRIBED = DescriptorSpace("", "uint8", 0, "l2", 1.0)  # of keypoints that are matched already
