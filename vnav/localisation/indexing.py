"""From landmarks and keyframes to the index that finds photos."""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.compiled import compiled
from vnav.config import IndexConfig
from vnav.core.arrays import Array, Floats
from vnav.core.camera import Intrinsics
from vnav.core.descriptor_space import DescriptorSpace
from vnav.core.map_index import MapIndex, spans_of
from vnav.core.mapping import FrameFeatures, Landmarks
from vnav.core.tree import VocabularyTree
from vnav.core.voxels import Voxels
from vnav.localisation.database import SAME_POINT_M

SAMPLE = 500  # descriptors that the map's own statistics are taken from
QUARTILE = 0.75
AT_ONCE = 20_000  # landmarks, or descriptors that are made a mean of
SAMPLE_AT_ONCE = 25  # descriptors that are held against all others


@dataclass(frozen=True)
class MappedKeyframe:
    """A keyframe in its place: pose (4, 4), covariance (6, 6) of its tangent, and camera."""

    keyframe: FrameFeatures
    T_world_camera: Array
    covariance: Array
    intrinsics: Intrinsics


def build(
    landmarks: Landmarks,
    retired: NDArray[np.bool_],
    keyframes: Sequence[MappedKeyframe],
    tree: VocabularyTree,
    voxels: Voxels,
    config: IndexConfig,
    rng: np.random.Generator,
) -> MapIndex:
    """The index of a map; without landmarks it finds nothing, but is legal.

    ``retired`` (L,): landmarks that are kept, but not described, so that nothing matches them;
    ``voxels``: what stands in the way of looks; ``rng`` draws the sample for the map's own
    statistics.
    """
    means, owner, patch_world, paths = _described(landmarks, retired, keyframes, tree)
    covisible = _covisible(landmarks, len(keyframes), config.min_shared_landmarks)
    reference = landmarks.keyframe[np.unique(landmarks.landmark, return_index=True)[1]]
    return MapIndex(
        points_world=landmarks.points_world,
        sigma_m=landmarks.sigma_m,
        retired=retired,
        descriptors=means,
        owner=owner,
        described_start=_starts(owner, len(landmarks)),
        described=np.argsort(owner, kind="stable").astype(np.int32),
        patch_world=patch_world,
        span=spans_of(paths, len(tree.level)),
        seen_start=_starts(landmarks.landmark, len(landmarks)),
        seen_by=landmarks.keyframe,
        sees_start=_starts(landmarks.keyframe, len(keyframes)),
        sees=landmarks.landmark[np.argsort(landmarks.keyframe, kind="stable")],
        neighbours=_neighbours(landmarks.points_world, reference, covisible, config.neighbours),
        covisible=covisible,
        T_world_keyframe=np.array([k.T_world_camera for k in keyframes]).reshape(-1, 4, 4),
        keyframe_covariance=np.array([k.covariance for k in keyframes]).reshape(-1, 6, 6),
        solid_away=voxels.away,
        solid_origin=voxels.origin,
        solid_m=np.array([voxels.edge_m]),
        distractor_distance=_distractor_distance(
            tree.space, means, landmarks.points_world[owner], reference[owner], covisible, rng
        ),
    )


def _described(
    landmarks: Landmarks,
    retired: NDArray[np.bool_],
    keyframes: Sequence[MappedKeyframe],
    tree: VocabularyTree,
) -> tuple[NDArray[Any], NDArray[np.int32], Floats, NDArray[np.int32]]:
    """Mean descriptors, their landmarks, patches and tree paths, in the order of the leaves."""
    descriptors, patches = _observed(landmarks, keyframes, tree.space)
    kept = ~retired[landmarks.landmark]
    of_kept = landmarks.landmark[kept], descriptors[kept], patches[kept]
    means, owner, patch_world = _means(*of_kept, tree)
    paths = tree.quantise(means)
    order = np.lexsort(paths.T[::-1])
    return means[order], owner[order], patch_world[order], paths[order]


def _observed(
    landmarks: Landmarks, keyframes: Sequence[MappedKeyframe], space: DescriptorSpace
) -> tuple[NDArray[Any], Array]:
    """Descriptors (M, W) and patches (M, 3) in the world of every observation."""
    descriptors = np.zeros((len(landmarks.landmark), space.width), space.dtype)
    patches = np.zeros((len(landmarks.landmark), 3))
    by_keyframe = np.argsort(landmarks.keyframe, kind="stable")
    starts = _starts(landmarks.keyframe, len(keyframes))
    for k, mapped in enumerate(keyframes):
        rows = by_keyframe[starts[k] : starts[k + 1]]
        features = mapped.keyframe.features[landmarks.feature[rows].astype(np.intp)]
        R, centre = mapped.T_world_camera[:3, :3], mapped.T_world_camera[:3, 3]
        depth = (landmarks.points_world[landmarks.landmark[rows]] - centre) @ R[:, 2]
        radius_m = features.scales_px / 2 * depth / mapped.intrinsics.fx
        angle = features.angles_rad
        axis = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], 1)
        descriptors[rows] = features.descriptors
        patches[rows] = radius_m[:, None] * axis @ R.T
    return descriptors, patches


def _means(
    landmark: NDArray[np.int32],
    descriptors: NDArray[Any],
    patches: Array,
    tree: VocabularyTree,
) -> tuple[NDArray[Any], NDArray[np.int32], Floats]:
    """One mean descriptor per landmark and word, its landmark, and its mean patch."""
    if not len(landmark):
        return descriptors, landmark, patches.astype(np.float32)
    word = tree.quantise(descriptors)[:, -1]
    order = np.lexsort((word, landmark))
    landmark, word = landmark[order], word[order]
    new = np.append(True, (np.diff(landmark) != 0) | (np.diff(word) != 0))
    first = np.flatnonzero(new)
    count = np.diff(np.append(first, len(order)))[:, None]
    patch = np.add.reduceat(patches[order], first) / count
    means = _mean_of_runs(descriptors, order, first, tree.space)
    return means, landmark[first], patch.astype(np.float32)


def _mean_of_runs(
    descriptors: NDArray[Any],
    order: NDArray[np.intp],
    first: NDArray[np.intp],
    space: DescriptorSpace,
) -> NDArray[Any]:
    """The mean descriptor of each run of the order, by where it begins; few are floats at once."""
    ends, means = np.append(first[1:], len(order)), []
    for runs in np.array_split(np.arange(len(first)), 1 + len(first) // AT_ONCE):
        begin, end = first[runs[0]], ends[runs[-1]]
        vectors = space.vectors(descriptors[order[begin:end]])
        count = (ends - first)[runs, None]
        means.append(space.nearest(np.add.reduceat(vectors, first[runs] - begin) / count))
    return np.concatenate(means)


def _starts(group: NDArray[np.int32], groups: int) -> NDArray[np.int32]:
    return np.append(0, np.cumsum(np.bincount(group, minlength=groups))).astype(np.int32)


def _covisible(landmarks: Landmarks, keyframes: int, shared: int) -> NDArray[np.bool_]:
    """Pairs of keyframes that have enough landmarks in common."""
    from scipy.sparse import csr_matrix

    ones = np.ones(len(landmarks.landmark), np.int32)
    shape = len(landmarks), keyframes
    sees = csr_matrix((ones, (landmarks.landmark, landmarks.keyframe)), shape)
    return np.asarray((sees.T @ sees).toarray() >= shared) | np.eye(keyframes, dtype=bool)


def _neighbours(
    points: Floats, reference: NDArray[np.int32], covisible: NDArray[np.bool_], count: int
) -> NDArray[np.int32]:
    """The nearest landmarks (L, count) of those that are seen together with a landmark.

    They are seen by keyframes covisible with its reference keyframe, the first that saw it. Claim
    4, 2.6.
    """
    from scipy.spatial import cKDTree

    found = np.tile(np.arange(len(points), dtype=np.int32)[:, None], (1, count))
    if not len(points):
        return found
    tree, most = cKDTree(points), min(2 * count, len(points))
    for of in np.array_split(np.arange(len(points)), 1 + len(points) // AT_ONCE):
        _, near = tree.query(points[of], most, workers=-1)
        place = reference[of], reference, covisible
        _keep_together(found[of[0] : of[-1] + 1], near.reshape(len(of), -1), *place)
    return found


@compiled
def _keep_together(
    found: NDArray[np.int32],
    near: NDArray[np.intp],
    own_reference: NDArray[np.int32],
    reference: NDArray[np.int32],
    covisible: NDArray[np.bool_],
) -> None:
    """Fill in, of the landmarks near each (N, K), the first that are seen together with it."""
    for n in range(len(near)):
        kept = 0
        for other in near[n]:
            if kept < found.shape[1] and covisible[own_reference[n], reference[other]]:
                found[n, kept] = other
                kept += 1


def _distractor_distance(
    space: DescriptorSpace,
    descriptors: NDArray[Any],
    points: Floats,
    reference: NDArray[np.int32],
    covisible: NDArray[np.bool_],
    rng: np.random.Generator,
) -> Floats:
    """How far (1,) a descriptor typically is from the nearest of another thing in its place.

    The upper quartile: things that repeat themselves (bricks, tiles) do not make it small.
    """
    count = min(SAMPLE, len(descriptors))
    sample = np.sort(rng.choice(len(descriptors), count, replace=False)) if count else np.arange(0)
    values = space.vectors(descriptors)
    half_norm = np.einsum("ij,ij->i", values, values) / 2

    def nearest(part: NDArray[np.intp]) -> Floats:
        half = half_norm[part, None] + half_norm - values[part] @ values.T
        near = [np.abs(points[part, None, k] - points[:, k]) < SAME_POINT_M for k in range(3)]
        half[np.logical_and.reduce(near)] = np.inf
        half[~covisible[reference[part]].take(reference, 1)] = np.inf
        return space.distance(2 * half.min(1, initial=np.inf))

    parts = 1 + count // SAMPLE_AT_ONCE
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        found = np.concatenate(list(pool.map(nearest, np.array_split(sample, parts))))
    found = found[np.isfinite(found)]
    return np.asarray(np.quantile(found if len(found) else [0.0], QUARTILE, keepdims=True))
