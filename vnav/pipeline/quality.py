"""What a map knows of its own faults, and the verdict on it.

Thresholds were fitted on rendered maps by benchmarks/verdicts.py, as docs/decisions.md says.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import compress
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vnav.checking.motions import Seen, contradicting_loops, unborne_steps
from vnav.config import Config
from vnav.core.arrays import Array, evenly
from vnav.core.frame import Edge
from vnav.core.graph import best_into, ends_of
from vnav.core.mapping import CONTRADICTS, LOST, Odometry
from vnav.core.reduced_frame import ReducedFrame
from vnav.core.view_overlap import view_overlap
from vnav.io.store.artifacts import (
    load_keyframe,
    load_loop_edges,
    load_loops,
    load_odometry,
    load_optimised,
    map_cameras,
)
from vnav.io.store.map_folder import MapFolder
from vnav.loop_closing.loop_candidates import are_apart
from vnav.optimisation.camera_fit import CameraFit
from vnav.optimisation.camera_motion import velocities
from vnav.registration.reduction import reduced
from vnav.registration.surface_agreement import Agreement, agreements, disagreeing
from vnav.tracking.pose_choice import UNSURE

MOST_PAIRS = 150  # of keyframes, and of rejected loops, that are looked at
MIN_OVERLAP = 0.3  # share of the view that both see
NEIGHBOURS = 1, 2  # keyframes onward that tell what is usual
DISAGREEING, LEAST_DISAGREEING = 0.2, 2  # share of revisits, and number, that speak against a map
LEAST_CONTRADICTING = 5  # rejected loops that do; chance makes 1.5 of 150
LEAST_UNSURE = 2  # frames in doubt that do
WRONG_CAMERA, SURE_SIGMAS = 0.025, 5.0  # off by: of the focal length, and standard deviations
FITTED = (  # and its standard deviation, and what was given
    "a focal length of {:.1f} px (+- {:.1f}) where {:.1f} px were given",
    "cx of {:.1f} px (+- {:.1f}) where {:.1f} px were given",
    "cy of {:.1f} px (+- {:.1f}) where {:.1f} px were given",
    "a radial distortion k1 of {:.2f} (+- {:.2f}) that was not given",
)


@dataclass(frozen=True)
class Quality:
    """Why a map may be wrong, where, and what to do; ``doubts`` is empty where nothing says so."""

    doubts: tuple[str, ...]
    values: dict[str, Any]

    @property
    def line(self) -> str:
        """The verdict for a person."""
        if self.doubts:
            return f"doubtful, for {len(self.doubts)} of 5 reasons"
        return "good: revisits, loops, steps, motions and cameras agree"


def assess(folder: MapFolder, config: Config) -> Quality:
    """The verdict on a finished map, by its revisits, loops, steps, motions and cameras."""
    odometry, poses = load_odometry(folder), load_optimised(folder).T_world_camera
    rows, registration = odometry.keyframe_rows, config.registration
    twists = velocities(poses, odometry.frames)

    @cache
    def seen(row: int) -> ReducedFrame:
        return reduced(load_keyframe(folder, row, odometry.frames)).moving(twists[row])

    revisits, neighbours = _compared(folder, odometry, poses, seen, config)
    apart = disagreeing(revisits, neighbours)
    loops, rejected = _loops(folder)
    against = contradicting_loops(evenly(rejected, MOST_PAIRS), poses, seen, registration)
    unborne = unborne_steps(rows, odometry.segment, poses, seen, registration)
    unsure = unsure_rows(odometry)
    wrong = _wrong_fits(folder)
    told = (
        _disagreement(apart, revisits, odometry),
        _contradiction(against, odometry),
        _unborne(unborne, odometry),
        _uncertainty(unsure, odometry),
        _wrong_cameras(wrong),
    )
    doubts = tuple(filter(None, told))
    values = {
        "verdict": "doubtful" if doubts else "good",
        "doubts": list(doubts),
        "revisits": len(revisits),
        "revisits_disagreeing": len(apart),
        "loops": loops,
        "loops_rejected": len(rejected),
        "loops_contradicting": len(against),
        "steps_unborne": len(unborne),
        "motions_unsure": len(unsure),
        "cameras_wrong": len(wrong),
    }
    return Quality(doubts, values)


def unsure_rows(odometry: Odometry) -> NDArray[np.intp]:
    """Frames none of whose motions from earlier ones is likely to be right."""
    best = best_into(odometry.edges)
    return np.array(sorted(row for row, p in best.items() if p < UNSURE), np.intp)


def _wrong_fits(folder: MapFolder) -> list[CameraFit]:
    """Of cameras that the images contradict, by so much that they bend the map."""
    values = folder.report("optimise").get("values", {})
    fits = [CameraFit(**told) for told in values.get("camera_fits", [])]
    return [fit for fit in fits if _is_wrong(fit).any()]


def _is_wrong(fit: CameraFit) -> NDArray[np.bool_]:
    """Whether each of its parameters is (4,)."""
    return np.asarray((fit.off > WRONG_CAMERA) & (fit.off_sigmas > SURE_SIGMAS))


def _loops(folder: MapFolder) -> tuple[int, list[Edge]]:
    """How many loops were found, and those that the map turned down."""
    edges, _ = load_loop_edges(folder)
    found = [v for v in load_loops(folder) if v.accepted or v.reason == CONTRADICTS]
    return len(found), list(compress(edges, (not v.accepted for v in found)))


def _compared(
    folder: MapFolder, odometry: Odometry, poses: Array, seen: Seen, config: Config
) -> tuple[list[Agreement], list[Agreement]]:
    """How keyframes agree with those that see the same at another time, and with the next."""
    rows = odometry.keyframe_rows
    part = np.where(np.isfinite(poses[:, 0, 0]), 0, LOST).astype(np.int32)
    overlap = view_overlap(odometry, poses, part, map_cameras(folder))

    def compare(wanted: NDArray[np.bool_]) -> list[Agreement]:
        pairs = evenly(rows[np.argwhere(wanted)].tolist(), MOST_PAIRS)
        return agreements(pairs, poses, seen, config.registration)

    apart = are_apart(odometry, config.loops.exclude_s)
    again = np.triu(apart & (overlap >= MIN_OVERLAP))
    on = np.zeros_like(again)
    for step in NEIGHBOURS:
        on |= np.eye(len(rows), k=step, dtype=bool) & (overlap >= MIN_OVERLAP) & ~apart
    return compare(again), compare(on)


def _disagreement(apart: Sequence[Agreement], of: Sequence[Agreement], odometry: Odometry) -> str:
    if len(apart) <= max(DISAGREEING * len(of), LEAST_DISAGREEING - 1):
        return ""
    where = _within([(a.i, a.j) for a in apart], odometry)
    return (
        f"{len(apart)} of {len(of)} pairs of keyframes that see one place again disagree on it,"
        f" within {where}; record the place anew, slower and with a loop"
    )


def _contradiction(against: Sequence[Edge], odometry: Odometry) -> str:
    if len(against) < LEAST_CONTRADICTING:
        return ""
    return (
        f"{len(against)} loops contradict the map and fit the images better, within"
        f" {_within(ends_of(against), odometry)}; places that look the same may have"
        " been taken for one, or the track is wrong: record with more that is unique in view"
    )


def _unborne(unborne: Sequence[tuple[int, int]], odometry: Odometry) -> str:
    if not unborne:
        return ""
    where, count = _within(unborne, odometry), len(odometry.keyframes) - 1
    return (
        f"{len(unborne)} of {count} steps from keyframe to keyframe do not fit the images, within"
        f" {where}; the track is wrong there, by what moved or repeated, or the camera was too"
        " fast: record slower, with more of what stands still"
    )


def _uncertainty(unsure: NDArray[np.intp], odometry: Odometry) -> str:
    if len(unsure) < LEAST_UNSURE:
        return ""
    return (
        f"the motion of {len(unsure)} frames is in doubt, within"
        f" {odometry.frames.rows_text(unsure)}; what repeats or moves filled the view: record with"
        " more of what stands still and is unique"
    )


def _wrong_cameras(fits: Sequence[CameraFit]) -> str:
    told = [
        text.format(fitted, sigma, given)
        for fit in fits
        for text, fitted, sigma, given in compress(
            zip(FITTED, fit.fitted, fit.sigma, fit.given, strict=True), _is_wrong(fit)
        )
    ]
    if not told:
        return ""
    return (
        f"the images fit another camera: {', '.join(told)}; correct the camera, by 'vnav"
        " calibrate' or what its maker says, and build the map anew"
    )


def _within(pairs: ArrayLike, odometry: Odometry) -> str:
    return odometry.frames.rows_text(np.unique(pairs))
