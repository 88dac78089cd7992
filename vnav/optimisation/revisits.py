"""Keyframes that see one place at different times: whether they agree on it, and edges by that.

From two sides a place may share no features, and it has the same surfaces all the same.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vnav.config import Config, RegistrationConfig
from vnav.core import se3
from vnav.core.arrays import Array, evenly
from vnav.core.camera import Intrinsics
from vnav.core.camera_motion import motions_after
from vnav.core.frame import Edge, Rejected
from vnav.core.mapping import LOST, Odometry
from vnav.core.reduced_frame import Seen
from vnav.core.view_overlap import are_apart, view_overlap
from vnav.registration.dense import align_surfaces
from vnav.registration.surface_agreement import Agreement, agreements, borne_out_by, disagreeing

MOST_PAIRS = 150  # of keyframes that are looked at
MIN_OVERLAP = 0.3  # share of the view that both see
NEIGHBOURS = 1, 2  # keyframes onward that tell what is usual
DISAGREEING, LEAST_DISAGREEING = 0.2, 2  # share of revisits, and number, that speak against a map


Pair = tuple[int, int]


@dataclass(frozen=True)
class Revisits:
    """Pairs of keyframes, by row, that see one place at different times, and which disagree on it.

    ``T_i_j`` (P, 4, 4): how the depth cameras stood to each other, as the map has it; ``delayed``
    (N, 4, 4): how each frame's camera moved until its depth was measured.
    """

    pairs: tuple[Pair, ...]
    disagreeing: tuple[Pair, ...]
    T_i_j: Array
    delayed: Array

    @property
    def contradict(self) -> bool:
        """Whether they speak against the map: more of them disagree than in right ones."""
        return len(self.disagreeing) > max(DISAGREEING * len(self.pairs), LEAST_DISAGREEING - 1)


def find_revisits(
    odometry: Odometry,
    poses: Array,
    depth_delay_s: Array,
    cameras: Sequence[Intrinsics],
    seen: Seen,
    config: Config,
) -> Revisits:
    """Keyframes that see the same at different times, held against those that follow each other.

    ``poses`` (N, 4, 4) of all frames, NaN where there is none; each one's depth is measured so much
    later (N,); ``cameras``: one a capture.
    """
    delayed = motions_after(poses, odometry.frames, depth_delay_s)
    T_world_depth = poses @ delayed
    rows = odometry.keyframe_rows
    part = np.where(np.isfinite(poses[:, 0, 0]), 0, LOST).astype(np.int32)
    overlap = view_overlap(odometry, poses, part, cameras)

    def compare(wanted: NDArray[np.bool_]) -> list[Agreement]:
        pairs = evenly(rows[np.argwhere(wanted & (overlap >= MIN_OVERLAP))].tolist(), MOST_PAIRS)
        return agreements(pairs, T_world_depth, seen, config.registration)

    apart = are_apart(odometry, config.loops.exclude_s)
    next_to = [np.eye(len(rows), k=step, dtype=bool) for step in NEIGHBOURS]
    is_borne_out = borne_out_by(poses, seen, config.registration)
    again, on = compare(np.triu(apart)), compare(np.any(next_to, 0) & ~apart)
    pairs = tuple((each.i, each.j) for each in again)
    i, j = np.array(pairs, np.intp).reshape(-1, 2).T
    return Revisits(
        pairs,
        tuple((each.i, each.j) for each in disagreeing(again, on, is_borne_out)),
        se3.inverse(T_world_depth[i]) @ T_world_depth[j],
        delayed,
    )


def surface_edges(
    revisits: Revisits, joined: Collection[Pair], seen: Seen, config: RegistrationConfig
) -> list[Edge]:
    """Edges between the keyframes of revisits, by their surfaces alone, but those ``joined``."""
    edges = []
    delayed, back = revisits.delayed, se3.inverse(revisits.delayed)
    for (i, j), T_i_j in zip(revisits.pairs, revisits.T_i_j, strict=True):
        if (i, j) in joined:
            continue
        found = align_surfaces(seen(i), seen(j), config, T_i_j)
        if not isinstance(found, Rejected):
            edges.append(Edge(i, j, delayed[i] @ found.T_a_b @ back[j], found.information))
    return edges
