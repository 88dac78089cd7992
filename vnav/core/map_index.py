"""The index of a map: what finding a photo needs, laid out so that words are ranges of rows."""

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from vnav.core.arrays import frozen
from vnav.core.voxels import Voxels


@dataclass(frozen=True)
class MapIndex:
    """Landmarks, their descriptors in the order of the vocabulary tree's leaves, and visibility.

    Parameters
    ----------
    points_world, sigma_m
        (L, 3) and (L,) float32: the landmarks and their standard deviation.
    retired
        (L,) bool: landmarks of what has departed, which have no descriptors.
    descriptors, owner
        (D, W), as the tree's space has them, and (D,) int32: one mean descriptor per landmark and
        word, and its landmark.
    described_start, described
        (L + 1,) and (D,) int32: landmark l is described by the rows
        ``described[described_start[l]:described_start[l + 1]]`` of the descriptors.
    patch_world
        (D, 3) float32: from the landmark along its descriptor's orientation to the edge of the
        described patch, parallel to the image plane of the keyframes that saw it.
    span
        (nodes, 2) int32: rows of the descriptors below a node of the tree, first and one past last.
    seen_start, seen_by
        (L + 1,) and (M,) int32: landmark l was seen by the keyframes
        ``seen_by[seen_start[l]:seen_start[l + 1]]``.
    sees_start, sees
        (K + 1,) and (M,) int32: the same the other way round, landmarks of a keyframe.
    neighbours
        (L, n) int32: the nearest landmarks in space that are seen together with a landmark,
        itself first; rows that find fewer repeat the landmark.
    covisible
        (K, K) bool: keyframes that share enough landmarks; each is covisible with itself.
    T_world_keyframe, keyframe_covariance
        (K, 4, 4) and (K, 6, 6) float64.
    solid_away, solid_origin, solid_m
        (X, Y, Z) uint8, (3,) and (1,) float64: how many voxels away something stands, the outer
        corner of the first voxel, and their edge in metres (`Voxels`).
    distractor_distance
        (1,) float32: descriptor distance at which a landmark typically has its nearest landmark
        elsewhere in the map; stands in for a second-nearest that a word does not hold.
    """

    points_world: NDArray[np.float32]
    sigma_m: NDArray[np.float32]
    retired: NDArray[np.bool_]
    descriptors: NDArray[Any]
    owner: NDArray[np.int32]
    described_start: NDArray[np.int32]
    described: NDArray[np.int32]
    patch_world: NDArray[np.float32]
    span: NDArray[np.int32]
    seen_start: NDArray[np.int32]
    seen_by: NDArray[np.int32]
    sees_start: NDArray[np.int32]
    sees: NDArray[np.int32]
    neighbours: NDArray[np.int32]
    covisible: NDArray[np.bool_]
    T_world_keyframe: NDArray[np.float64]
    keyframe_covariance: NDArray[np.float64]
    solid_away: NDArray[np.uint8]
    solid_origin: NDArray[np.float64]
    solid_m: NDArray[np.float64]
    distractor_distance: NDArray[np.float32]

    def __post_init__(self) -> None:
        landmarks, descriptors = len(self.points_world), len(self.descriptors)
        keyframes, seen = len(self.T_world_keyframe), len(self.seen_by)
        shapes: dict[str, tuple[DTypeLike, tuple[int | None, ...]]] = {
            "points_world": (np.float32, (landmarks, 3)),
            "sigma_m": (np.float32, (landmarks,)),
            "retired": (np.bool_, (landmarks,)),
            "descriptors": (self.descriptors.dtype, (descriptors, None)),
            "owner": (np.int32, (descriptors,)),
            "described_start": (np.int32, (landmarks + 1,)),
            "described": (np.int32, (descriptors,)),
            "patch_world": (np.float32, (descriptors, 3)),
            "span": (np.int32, (None, 2)),
            "seen_start": (np.int32, (landmarks + 1,)),
            "seen_by": (np.int32, (seen,)),
            "sees_start": (np.int32, (keyframes + 1,)),
            "sees": (np.int32, (seen,)),
            "neighbours": (np.int32, (landmarks, None)),
            "covisible": (np.bool_, (keyframes, keyframes)),
            "T_world_keyframe": (np.float64, (keyframes, 4, 4)),
            "keyframe_covariance": (np.float64, (keyframes, 6, 6)),
            "solid_away": (np.uint8, (None, None, None)),
            "solid_origin": (np.float64, (3,)),
            "solid_m": (np.float64, (1,)),
            "distractor_distance": (np.float32, (1,)),
        }
        for name, (dtype, shape) in shapes.items():
            object.__setattr__(self, name, frozen(getattr(self, name), dtype, shape))

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Names of the arrays, in order."""
        return tuple(f.name for f in fields(cls))

    @property
    def keyframes(self) -> int:
        """Number of keyframes."""
        return len(self.T_world_keyframe)

    def keyframes_of(
        self, landmarks: NDArray[np.int32]
    ) -> tuple[NDArray[np.intp], NDArray[np.int32]]:
        """Every sighting of the given landmarks (N,): position in the argument, and keyframe."""
        position, row = rows_of(self.seen_start, landmarks)
        return position, self.seen_by[row]

    @cached_property
    def covisible_start(self) -> NDArray[np.intp]:
        """(K + 1,): where the keyframes covisible with one begin in `covisible_of`, and end."""
        return np.append(0, np.cumsum(self.covisible.sum(1)))

    @cached_property
    def covisible_of(self) -> NDArray[np.intp]:
        """The keyframes that are covisible with the first, with the second, and so on."""
        return np.nonzero(self.covisible)[1]

    @property
    def voxels(self) -> Voxels:
        """Where something stands."""
        return Voxels(self.solid_away, self.solid_origin, float(self.solid_m[0]))

    def landmarks_of(self, keyframes: NDArray[np.intp]) -> NDArray[np.int32]:
        """Landmarks that any of the keyframes saw, ascending."""
        seen = np.zeros(len(self.points_world), bool)
        seen[self.sees[rows_of(self.sees_start, keyframes)[1]]] = True
        return np.flatnonzero(seen).astype(np.int32)


def rows_of(
    start: NDArray[np.int32] | NDArray[np.intp], groups: NDArray[np.intp] | NDArray[np.int32]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows of the given groups: position of the group in the argument, and row, one a row."""
    return ranges(start[groups], start[1:][groups])


def ranges(
    begin: NDArray[np.int32] | NDArray[np.intp], end: NDArray[np.int32] | NDArray[np.intp]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """All numbers of the ranges [begin, end), and which range (R,) each comes from."""
    count = (end - begin).astype(np.intp)
    source = np.repeat(np.arange(len(count)), count)
    offset = np.arange(len(source)) - np.repeat(np.cumsum(count) - count, count)
    return source, begin[source] + offset


def spans_of(paths: NDArray[np.int32], nodes: int) -> NDArray[np.int32]:
    """Rows (nodes, 2), first and one past last, of sorted tree paths that pass each node."""
    span = np.zeros((nodes, 2), np.int32)
    for column in paths.T:
        node, first, count = np.unique(column, return_index=True, return_counts=True)
        span[node, 0], span[node, 1] = first, first + count
    return span
