"""Segments of odometry aligned by the loop closures between them, as far as these agree."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.frame import Edge

SAME_POSE_M, SAME_POSE_RAD = 0.3, 0.2  # two closures that place a segment alike
MIN_AGREEING = 3  # closures between captures: nothing there contradicts one that is wrong
Candidate = tuple[Array, Array, int]  # T_a_b, T_b_camera where it was measured, votes


def align_segments(
    T_segment_camera: Array,
    segment: NDArray[np.int32],
    capture: NDArray[np.int32],
    closures: Sequence[Edge],
) -> tuple[Array, NDArray[np.int32]]:
    """Poses (N, 4, 4) with segments aligned by closures, and the connected parts (N,) that remain.

    Two segments are aligned by the closure that most others between them agree with. One alone
    will do within a capture; between frames of different captures `MIN_AGREEING` must say the
    same. Frames of one part share a frame of reference: that of the part's first segment.
    """
    poses, part = T_segment_camera.copy(), segment.copy()
    while True:
        for (a, b), candidates in _between_parts(poses, part, capture, closures):
            T_a_b, votes = _consensus(candidates)
            if votes >= MIN_AGREEING:
                rows = part == b
                poses[rows] = T_a_b @ poses[rows]
                part[rows] = a
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


def _consensus(candidates: Sequence[Candidate]) -> tuple[Array, int]:
    """The ``T_a_b`` with most votes of those near to it where it was measured, and its votes."""
    T_a_b, T_b_camera, votes = (np.stack(column) for column in zip(*candidates, strict=True))
    apart = se3.inverse(T_a_b @ T_b_camera)[:, None] @ (T_a_b @ T_b_camera[:, None])
    count = same_pose(apart) @ votes
    best: Array = T_a_b[count.argmax()]
    return best, int(count.max())
