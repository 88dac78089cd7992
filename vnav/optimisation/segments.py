"""Segments of odometry aligned by the loop closures between them, as far as these agree."""

from collections.abc import Callable, Iterator, Sequence
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import Edge

SAME_POSE_M, SAME_POSE_RAD = 0.3, 0.2  # two closures that place a segment alike
MOST_ALIGNMENTS = 12  # of two segments that are looked at
MIN_AGREEING = 3  # closures between captures: nothing there contradicts one that is wrong
Candidate = tuple[Array, Array, int]  # T_a_b, T_b_camera where it was measured, votes
Inside = NDArray[np.bool_]  # which frames (N,)
Choose = Callable[[Sequence[Array], Inside, Inside], int | None]


def first(alignments: Sequence[Array], a: Inside, b: Inside) -> int:
    """Takes that of most votes, as where the images of keyframes are not at hand."""
    return 0


def align_segments(
    T_segment_camera: Array,
    segment: NDArray[np.int32],
    capture: NDArray[np.int32],
    closures: Sequence[Edge],
    right: Choose = first,
) -> tuple[Array, NDArray[np.int32]]:
    """Poses (N, 4, 4) with segments aligned by closures, and the connected parts (N,) that remain.

    Two segments are aligned by the closure that most others between them agree with. One alone
    will do within a capture; between frames of different captures `MIN_AGREEING` must say the
    same. Nothing else contradicts closures that take two places for one, so what both parts see
    decides: ``right`` says which of several poses (N, 4, 4), those of most votes first, fits for
    two sets of frames (N,), if any does.
    Frames of one part share a frame of reference: that of the part's first segment.
    """
    poses, part = T_segment_camera.copy(), segment.copy()
    while True:
        for (a, b), candidates in _between_parts(poses, part, capture, closures):
            aligned = list(_aligned(poses, part == b, candidates))
            number = right(aligned, part == a, part == b) if aligned else None
            if number is not None:
                poses, part = aligned[number], np.where(part == b, np.int32(a), part)
                break
        else:
            return poses, part


def same_pose(T_a_b: Array) -> NDArray[np.bool_]:
    """Whether two poses at this distance (..., 4, 4) count as the same."""
    near = np.linalg.norm(T_a_b[..., :3, 3], axis=-1) < SAME_POSE_M
    return np.asarray(near & (se3.rotation_angle(T_a_b) < SAME_POSE_RAD))


def _between_parts(
    poses: Array, part: NDArray[np.int32], capture: NDArray[np.int32], closures: Sequence[Edge]
) -> list[tuple[tuple[int, int], list[Candidate]]]:
    """Parts a < b with a candidate for each closure between them, those with most first."""
    found: dict[tuple[int, int], list[Candidate]] = {}
    for e in closures:
        a, b = int(part[e.i]), int(part[e.j])
        if a != b:
            T_a_b = poses[e.i] @ e.T_i_j @ se3.inverse(poses[e.j])
            pair, row, T = ((a, b), e.j, T_a_b) if a < b else ((b, a), e.i, se3.inverse(T_a_b))
            votes = MIN_AGREEING if capture[e.i] == capture[e.j] else 1
            found.setdefault(pair, []).append((T, poses[row], votes))
    return sorted(found.items(), key=lambda item: (len(item[1]), item[0]), reverse=True)


def _aligned(poses: Array, b: Inside, candidates: Sequence[Candidate]) -> Iterator[Array]:
    """Poses (N, 4, 4) where b's frames (N,) are aligned as votes say; most votes first."""
    for T_a_b in islice(_agreed(candidates), MOST_ALIGNMENTS):
        yield np.where(b[:, None, None], T_a_b @ poses, poses)


def _agreed(candidates: Sequence[Candidate]) -> Iterator[Array]:
    """Each ``T_a_b`` with votes enough, by those near to it where they were measured; most first.

    Those that agree with one are not asked again.
    """
    T_a_b, T_b_camera, votes = (np.stack(column) for column in zip(*candidates, strict=True))
    apart = se3.inverse(T_a_b @ T_b_camera)[:, None] @ (T_a_b @ T_b_camera[:, None])
    near, left = same_pose(apart), np.ones(len(votes), bool)
    while True:
        count = np.where(left, near @ (votes * left), 0)
        best = int(count.argmax())
        if count[best] < MIN_AGREEING:
            return
        yield T_a_b[best]
        left &= ~near[best]
