"""What a map knows of its own faults, and the verdict on it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vnav.checking.revisits import Agreement, agreement, disagreeing
from vnav.config import Config
from vnav.core import se3
from vnav.core.arrays import Array
from vnav.core.mapping import CONTRADICTS, LOST, LoopVerdict, Odometry
from vnav.core.reduced_frame import ReducedFrame, reduced
from vnav.io.store.artifacts import (
    load_keyframe,
    load_loops,
    load_odometry,
    load_optimised,
    map_cameras,
)
from vnav.io.store.map_folder import MapFolder
from vnav.loop_closing.loop_candidates import are_apart, view_overlap

MOST_PAIRS = 150  # of keyframes that are compared
MIN_OVERLAP = 0.3  # share of the view that both see
NEIGHBOURS = 1, 2  # keyframes onward that tell what is usual
DISAGREEING, LEAST_DISAGREEING = 0.2, 2  # share of revisits, and number, that speak against a map
CONTRADICTING, LEAST_CONTRADICTING = 0.5, 5  # share of loops, and number, that speak against it
UNSURE = 0.5  # probability of a motion, below which it is doubtful

Pair = tuple[int, int]


@dataclass(frozen=True)
class Quality:
    """Why a map may be wrong, where, and what to do; ``doubts`` is empty where nothing says so."""

    doubts: tuple[str, ...]
    values: dict[str, Any]

    @property
    def line(self) -> str:
        """The verdict for a person."""
        if self.doubts:
            return f"doubtful, for {len(self.doubts)} of 3 reasons"
        return "good: revisits, loops and motions agree"


def assess(folder: MapFolder, config: Config) -> Quality:
    """The verdict on a finished map, by its revisits, its loops and its motions."""
    odometry, poses = load_odometry(folder), load_optimised(folder).T_world_camera
    revisits, neighbours = _compared(folder, odometry, poses, config)
    apart = disagreeing(revisits, neighbours)
    loops = [v for v in load_loops(folder) if v.accepted or v.reason == CONTRADICTS]
    against = [v for v in loops if not v.accepted]
    unsure = unsure_rows(odometry)
    doubts = []
    if len(apart) > max(DISAGREEING * len(revisits), LEAST_DISAGREEING - 1):
        doubts.append(_disagreement(apart, revisits, odometry))
    if len(against) > max(CONTRADICTING * len(loops), LEAST_CONTRADICTING - 1):
        doubts.append(_contradiction(against, loops, odometry))
    if len(unsure):
        doubts.append(_uncertainty(unsure, odometry))
    values = {
        "verdict": "doubtful" if doubts else "good",
        "doubts": doubts,
        "revisits": len(revisits),
        "revisits_disagreeing": len(apart),
        "loops": len(loops),
        "loops_contradicting": len(against),
        "motions_unsure": len(unsure),
    }
    return Quality(tuple(doubts), values)


def unsure_rows(odometry: Odometry) -> NDArray[np.intp]:
    """Frames none of whose motions from earlier ones is likely to be right."""
    best = np.zeros(len(odometry.frames))
    into = np.zeros(len(best), bool)
    for edge in odometry.edges:
        best[edge.j] = max(best[edge.j], edge.probability)
        into[edge.j] = True
    return np.flatnonzero(into & (best < UNSURE))


def _compared(
    folder: MapFolder, odometry: Odometry, poses: Array, config: Config
) -> tuple[list[Agreement], list[Agreement]]:
    """How keyframes agree with those that see the same at another time, and with the next."""
    rows = odometry.keyframe_rows
    part = np.where(np.isfinite(poses[:, 0, 0]), 0, LOST).astype(np.int32)
    overlap = view_overlap(odometry, poses, part, map_cameras(folder))

    @cache
    def seen(k: int) -> ReducedFrame:
        return reduced(load_keyframe(folder, int(rows[k]), odometry.frames))

    def compare(pairs: Sequence[Pair]) -> list[Agreement]:
        found = (_agreement(pair, rows, poses, seen, config) for pair in pairs)
        return [agreement for agreement in found if agreement is not None]

    apart = are_apart(odometry, config.loops.exclude_s)
    again = np.triu(apart & (overlap >= MIN_OVERLAP))
    on = np.zeros_like(again)
    for step in NEIGHBOURS:
        on |= np.eye(len(rows), k=step, dtype=bool) & (overlap >= MIN_OVERLAP) & ~apart
    return compare(_spread(again)), compare(_spread(on))


def _agreement(
    pair: Pair,
    rows: NDArray[np.intp],
    poses: Array,
    seen: Callable[[int], ReducedFrame],
    config: Config,
) -> Agreement | None:
    i, j = rows[list(pair)].tolist()
    T_i_j = se3.inverse(poses[i]) @ poses[j]
    return agreement((i, j), (seen(pair[0]), seen(pair[1])), T_i_j, config.registration)


def _spread(wanted: NDArray[np.bool_]) -> list[Pair]:
    """`MOST_PAIRS` of the pairs (K, K) that are wanted, evenly from first to last."""
    pairs = np.argwhere(wanted)
    chosen = np.unique(np.linspace(0, len(pairs) - 1, min(MOST_PAIRS, len(pairs))).astype(int))
    return [(int(i), int(j)) for i, j in pairs[chosen]] if len(pairs) else []


def _disagreement(apart: Sequence[Agreement], of: Sequence[Agreement], odometry: Odometry) -> str:
    rows = np.unique([(a.i, a.j) for a in apart])
    return (
        f"{len(apart)} of {len(of)} pairs of keyframes that see one place again disagree on it,"
        f" within {odometry.frames.rows_text(rows)}; look at them with 'vnav report', and record"
        " the place anew, slower and with a loop"
    )


def _contradiction(
    against: Sequence[LoopVerdict], of: Sequence[LoopVerdict], odometry: Odometry
) -> str:
    rows = odometry.keyframe_rows[np.unique([(v.i, v.j) for v in against])]
    return (
        f"{len(against)} of {len(of)} loops contradict the map, within"
        f" {odometry.frames.rows_text(rows)}; places that look the same may have been taken for"
        " one, or the track is wrong: record with more that is unique in view"
    )


def _uncertainty(unsure: NDArray[np.intp], odometry: Odometry) -> str:
    return (
        f"the motion of {len(unsure)} frames is in doubt, within"
        f" {odometry.frames.rows_text(unsure)}; what repeats or moves filled the view: record with"
        " more of what stands still and is unique"
    )
