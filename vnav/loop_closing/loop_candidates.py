"""Pairs of keyframes that may see the same place: by appearance, by nearness of their poses."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.config import LoopsConfig
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.camera import Intrinsics
from vnav.core.mapping import FrameFeatures, Odometry
from vnav.core.tree import VocabularyTree
from vnav.features.appearance import tfidf_similarity

SAMPLE = 64  # points of a keyframe, of those with depth, that tell where it looks


@dataclass(frozen=True)
class LoopCandidate:
    """Keyframes i < j by number; ``source`` and ``score`` as in `LoopVerdict`."""

    i: int
    j: int
    source: str
    score: float


def by_appearance(
    odometry: Odometry, tree: VocabularyTree, config: LoopsConfig
) -> list[LoopCandidate]:
    """For each keyframe the most similar earlier ones by TF-IDF, and the two ends of the capture.

    A candidate needs a share of the similarity that neighbouring keyframes have (Galvez-Lopez,
    Tardos 2012), and must be farther away in time than ``exclude_s`` or in another segment.
    """
    similarity = tfidf_similarity(odometry.keyframes, tree)
    apart = are_apart(odometry, config.exclude_s)
    found: dict[tuple[int, int], LoopCandidate] = {}
    for j in range(1, len(similarity)):
        scores = np.where(apart[j, :j], similarity[j, :j], 0.0)
        least = max(config.min_relative_score * similarity[j, j - 1], 0.0)
        for i in np.argsort(-scores, kind="stable")[: config.candidates].tolist():
            if scores[i] > least:
                found[i, j] = LoopCandidate(i, j, "appearance", float(scores[i]))
    last = len(similarity) - 1
    if last > 0 and apart[0, last]:
        ends = LoopCandidate(0, last, "ends", float(similarity[0, last]))
        found.setdefault((0, last), ends)
    return list(found.values())


def by_proximity(
    overlap: Array, config: LoopsConfig, tried: set[tuple[int, int]]
) -> list[LoopCandidate]:
    """Pairs of keyframes that should see the same by their poses and were not tried yet.

    ``overlap`` (K, K): see `view_overlap`.
    """
    found: dict[tuple[int, int], LoopCandidate] = {}
    for j in range(len(overlap)):
        for i in np.argsort(-overlap[j], kind="stable")[: config.proximity_candidates].tolist():
            pair = min(i, j), max(i, j)
            if overlap[j, i] >= config.proximity_overlap and pair not in tried:
                found[pair] = LoopCandidate(*pair, "proximity", float(overlap[j, i]))
    return [found[pair] for pair in sorted(found)]


def view_overlap(
    odometry: Odometry,
    T_world_camera: Array,
    part: NDArray[np.int32],
    cameras: Sequence[Intrinsics],
) -> Array:
    """Share (K, K) of two keyframes' points that lie in each other's image, the lesser of both.

    Zero on the diagonal and between frames of different parts (N,) of the pose graph.
    """
    rows, captures = odometry.keyframe_rows, odometry.frames.capture
    T_camera_world = se3.inverse(T_world_camera[rows])
    share = np.zeros((len(rows), len(rows)))
    for i, keyframe in enumerate(odometry.keyframes):
        points = _sampled_points(keyframe)
        in_camera = se3.transform(T_camera_world @ T_world_camera[rows[i]], points)
        for c, camera in enumerate(cameras):
            of_camera = captures[rows] == c
            px = camera.project(in_camera[of_camera])
            inside = ((px >= 0) & (px < camera.size)).all(-1)
            share[i, of_camera] = inside.mean(1) if len(points) else 0.0
    same_part = part[rows][:, None] == part[rows]
    overlap = np.where(same_part, np.minimum(share, share.T), 0.0)
    np.fill_diagonal(overlap, 0.0)
    return overlap


def are_apart(odometry: Odometry, exclude_s: float) -> NDArray[np.bool_]:
    """Which keyframes (K, K) are far apart in time, or of different segments or captures."""
    frames, rows = odometry.frames, odometry.keyframe_rows
    stamp_s, segment, capture = frames.stamp_s[rows], odometry.segment[rows], frames.capture[rows]
    apart = np.abs(stamp_s[:, None] - stamp_s) > exclude_s
    apart |= segment[:, None] != segment
    return np.asarray(apart | (capture[:, None] != capture))


def _sampled_points(keyframe: FrameFeatures) -> NDArray[np.float32]:
    """About `SAMPLE` (S, 3) of a keyframe's 3D points."""
    points = keyframe.points_camera[keyframe.has_depth]
    return points[:: max(1, len(points) // SAMPLE)]
