"""What a map knows of its own faults, and the verdict on it.

Thresholds were fitted on rendered maps by benchmarks/verdicts.py, as docs/decisions.md says.
"""

from collections.abc import Sequence, Sized
from dataclasses import dataclass, fields, replace
from functools import cache
from itertools import compress
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vnav.checking.motions import contradicting_loops, standing_steps, unborne_steps
from vnav.config import Config, RegistrationConfig
from vnav.core.arrays import Array, evenly
from vnav.core.camera import Intrinsics
from vnav.core.frame import Edge
from vnav.core.graph import best_into, component_roots, ends_of
from vnav.core.jumps import jumps
from vnav.core.mapping import CONTRADICTS, Odometry
from vnav.core.reduced_frame import ReducedFrame, Seen
from vnav.features.description import near_depth
from vnav.io.store.artifacts import (
    load_keyframe,
    load_keyframe_blocks,
    load_keyframe_depth,
    load_loop_edges,
    load_loops,
    load_mended_edges,
    load_odometry,
    load_optimised,
    load_whole_keyframe,
    map_cameras,
)
from vnav.io.store.map_folder import MapFolder
from vnav.optimisation.camera_fit import CameraFit
from vnav.optimisation.displacement import without_displacement
from vnav.optimisation.mending import TAKEN
from vnav.optimisation.revisits import Revisits, find_revisits
from vnav.optimisation.sensor_errors import MovingSensor, SensorErrors
from vnav.registration.reduction import reduced
from vnav.tracking.pose_choice import UNSURE

MOST_LOOPS = 150  # rejected ones, that are looked at
LEAST_CONTRADICTING = 5  # rejected loops that do; chance makes 1.5 of 150
LEAST_UNSURE = 2  # frames in doubt that do
WRONG_CAMERA, SURE_SIGMAS = 0.025, 5.0  # off by: of the focal length, and standard deviations
MAX_SIGMA = 0.01  # of the focal length; errors that all views share are as large where it is more
OF_GIVEN = (
    "the given poses are off there, or of another time than the images: correct them, or let vnav"
    " adjust them by --set optimise.given_poses=prior"
)
COUNTED = (
    *("revisits", "revisits_disagreeing", "loops", "loops_rejected", "loops_contradicting"),
    *("steps_unborne", "steps_standing", "motions_unsure", "places_unsure", "jumps"),
    "cameras_wrong",
)
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
            return f"doubtful, for {len(self.doubts)} of 8 reasons"
        return f"good: {self.values['agreement']}"


def assess(folder: MapFolder, config: Config) -> Quality:
    """The verdict on a finished map by its revisits, loops, steps, masks, motions and cameras."""
    odometry, solved = load_odometry(folder), load_optimised(folder)
    poses, delay_s = solved.T_world_camera, solved.depth_delay_s
    rows, registration = odometry.keyframe_rows, config.registration
    optimised, cameras = folder.report("optimise").get("values", {}), map_cameras(folder)
    sensor = _sensor(folder, odometry, poses, cameras, config)
    seen = _seen(folder, odometry, sensor)
    revisits = find_revisits(odometry, poses, delay_s, cameras, seen, config)
    loops, rejected = _loops(folder)
    against = _against(rejected, poses, seen, sensor, _sensor_errors(optimised, len(cameras)))
    motions = *load_mended_edges(folder), *odometry.degenerate_edges
    unborne = unborne_steps(rows, motions, poses, seen, registration)
    standing = _standing(folder, odometry, motions, poses, registration)
    unsure, wrong = unsure_rows(odometry, poses), _wrong_fits(optimised)
    taken = [(m["first"], m["last"]) for m in optimised.get("mended", []) if m["how"] == TAKEN]
    jumped = jumps(odometry.frames, poses, np.zeros_like(odometry.segment))
    posed = int(np.isfinite(poses[:, 0, 0]).sum())
    told = (
        _disagreement(revisits, odometry),
        _contradiction(against, odometry),
        _unborne(unborne, odometry),
        _masked(standing, odometry),
        _uncertainty(unsure, loops, odometry),
        _likeness(taken, odometry),
        _jumping(jumped, odometry),
        _wrong_cameras(wrong),
    )
    doubts = tuple(filter(None, told))
    seen_twice = revisits.pairs, revisits.disagreeing
    others = loops, rejected, against, unborne, standing, unsure, taken, jumped, wrong
    counted: tuple[Sized, ...] = *seen_twice, *others
    values = {
        "verdict": "doubtful" if doubts else "good",
        "doubts": list(doubts),
        "agreement": "" if doubts else agreement(len(revisits.pairs), len(loops), odometry, posed),
        **{name: len(found) for name, found in zip(COUNTED, counted, strict=True)},
    }
    return Quality(doubts, values)


def agreement(revisits: int, loops: int, odometry: Odometry, posed: int) -> str:
    """What was there to disagree, and did not; ``posed``: frames that have a pose."""
    steps, motions = max(0, len(odometry.keyframes) - 1), len(best_into(odometry.edges))
    counts = {"revisit": revisits, "loop": loops, "step": steps, "motion": motions}
    told = [f"{n} {what}{'s' * (n > 1)}" for what, n in counts.items() if n]
    drift = "" if revisits or loops else "; no place was seen twice, so drift was not checked"
    of = len(odometry.frames)
    part = "" if posed == of else f"; only {posed} of {of} frames are in it"
    return f"no fault in {', '.join(told) or 'a single frame'}{drift}{part}"


def unsure_rows(odometry: Odometry, T_world_camera: Array) -> NDArray[np.intp]:
    """Frames in the map none of whose motions from earlier ones is likely to be right.

    ``T_world_camera`` (N, 4, 4), NaN of frames that are not in it.
    """
    best, posed = best_into(odometry.edges), np.isfinite(T_world_camera[:, 0, 0])
    return np.array(sorted(row for row, p in best.items() if p < UNSURE and posed[row]), np.intp)


def are_joined(first_rows: NDArray[np.intp], loops: Sequence[Edge]) -> bool:
    """Whether loops join all parts of a recording, cut before each of some rows (P,)."""
    parts = np.searchsorted(first_rows, ends_of(loops), side="right").tolist()
    between = [replace(loop, i=i, j=j) for loop, (i, j) in zip(loops, parts, strict=True)]
    return component_roots(np.arange(len(first_rows) + 1), between) == [0]


def _sensor(
    folder: MapFolder,
    odometry: Odometry,
    T_world_camera: Array,
    cameras: Sequence[Intrinsics],
    config: Config,
) -> MovingSensor:
    """The keyframes by a sensor that moves as the poses (N, 4, 4) tell."""

    def depth_of(row: int) -> NDArray[np.float32]:
        return near_depth(load_keyframe_depth(folder, row), config)

    return MovingSensor.along(T_world_camera, odometry, cameras, depth_of, config.registration)


def _seen(folder: MapFolder, odometry: Odometry, sensor: MovingSensor) -> Seen:
    """The keyframes by their rows, each with the twist of its camera."""

    @cache
    def seen(row: int) -> ReducedFrame:
        frame = load_keyframe(folder, row, odometry.frames)
        return reduced(frame).moving(sensor.cameras[row].twist)

    return seen


def _standing(
    folder: MapFolder,
    odometry: Odometry,
    motions: Sequence[Edge],
    T_world_camera: Array,
    config: RegistrationConfig,
) -> list[tuple[int, int]]:
    """Steps most of which is taken for moving, but stands."""

    @cache
    def whole(row: int) -> ReducedFrame:
        return reduced(load_whole_keyframe(folder, row, odometry.frames))

    def moving(row: int) -> NDArray[np.bool_]:
        blocks = load_keyframe_blocks(folder, row)
        return np.zeros((1, 1), bool) if blocks is None else blocks

    steps = odometry.keyframe_rows, motions, T_world_camera
    return standing_steps(*steps, whole, moving, config)


def _sensor_errors(optimised: dict[str, Any], captures: int) -> list[SensorErrors]:
    """Those of each capture's sensor that were found with the poses; 0 where nothing was told."""
    names = [field.name for field in fields(SensorErrors)]
    of_each = optimised.get("sensors", [{}] * captures)
    return [SensorErrors(*(told.get(name, 0.0) for name in names)) for told in of_each]


def _wrong_fits(optimised: dict[str, Any]) -> list[CameraFit]:
    """Of cameras that the images contradict, by so much that they bend the map."""
    fits = [CameraFit(**told) for told in optimised.get("camera_fits", [])]
    return [fit for fit in fits if _is_wrong(fit).any()]


def _is_wrong(fit: CameraFit) -> NDArray[np.bool_]:
    """Whether each of its parameters is (4,)."""
    is_known = fit.off < MAX_SIGMA * fit.off_sigmas
    return np.asarray((fit.off > WRONG_CAMERA) & (fit.off_sigmas > SURE_SIGMAS) & is_known)


def _loops(folder: MapFolder) -> tuple[list[Edge], list[Edge]]:
    """Loops that hold the map, and edges that it turned down, between neighbours too."""
    edges, _ = load_loop_edges(folder)
    found = [v for v in load_loops(folder) if v.accepted or v.reason == CONTRADICTS]
    kept = compress(edges, (v.accepted and v.is_loop for v in found))
    return list(kept), list(compress(edges, (not v.accepted for v in found)))


def _against(
    rejected: Sequence[Edge],
    T_world_camera: Array,
    seen: Seen,
    sensor: MovingSensor,
    errors: Sequence[SensorErrors],
) -> list[Edge]:
    """Those that contradict the map also without what the sensor's errors displace."""
    asked = evenly(rejected, MOST_LOOPS)
    still = without_displacement(asked, T_world_camera, sensor, errors)
    return contradicting_loops(still, T_world_camera, seen, sensor.config)


def _disagreement(revisits: Revisits, odometry: Odometry) -> str:
    if not revisits.contradict:
        return ""
    apart, of = revisits.disagreeing, len(revisits.pairs)
    return (
        f"{len(apart)} of {of} pairs of keyframes that see one place again disagree on it,"
        f" within {_within(apart, odometry)};"
        f" {_advice(odometry, 'record the place anew, slower and with a loop')}"
    )


def _contradiction(against: Sequence[Edge], odometry: Odometry) -> str:
    if len(against) < LEAST_CONTRADICTING:
        return ""
    mistaken = (
        "places that look the same may have been taken for one, or the track is wrong: record with"
        " more that is unique in view"
    )
    return (
        f"{len(against)} loops contradict the map and fit the images better, within"
        f" {_within(ends_of(against), odometry)}; {_advice(odometry, mistaken)}"
    )


def _unborne(unborne: Sequence[tuple[int, int]], odometry: Odometry) -> str:
    if not unborne:
        return ""
    where, count = _within(unborne, odometry), len(odometry.keyframes) - 1
    mistaken = (
        "the track is wrong there, by what moved or repeated, or the camera was too fast: record"
        " slower, with more of what stands still"
    )
    return (
        f"{len(unborne)} of {count} steps from keyframe to keyframe do not fit the images, within"
        f" {where}; {_advice(odometry, mistaken)}"
    )


def _masked(standing: Sequence[tuple[int, int]], odometry: Odometry) -> str:
    if not standing:
        return ""
    mistaken = (
        "the track is wrong there, by what repeated, or all that is seen moved: record with more"
        " of what stands still and is unique"
    )
    return (
        f"most of the view is taken for moving in {len(standing)} steps from keyframe to keyframe,"
        f" but stands still between the two, within {_within(standing, odometry)};"
        f" {_advice(odometry, mistaken)}"
    )


def _advice(odometry: Odometry, otherwise: str) -> str:
    """What may be wrong, and what to do; of poses that vnav has not found, another thing."""
    return OF_GIVEN if odometry.given else otherwise


def _uncertainty(unsure: NDArray[np.intp], loops: Sequence[Edge], odometry: Odometry) -> str:
    if len(unsure) < LEAST_UNSURE or are_joined(unsure, loops):
        return ""
    return (
        f"the motion of {len(unsure)} frames is in doubt, within"
        f" {odometry.frames.rows_text(unsure)}; what repeats or moves filled the view: record with"
        " more of what stands still and is unique"
    )


def _likeness(taken: Sequence[tuple[int, int]], odometry: Odometry) -> str:
    if not taken:
        return ""
    return (
        f"{len(taken)} time{'s' * (len(taken) > 1)}, after an interruption or in another recording,"
        f" the camera may be in another place than it was taken for, within"
        f" {_within(taken, odometry)}; record without a break, or come back to what is unique"
    )


def _jumping(jumped: Sequence[tuple[int, int]], odometry: Odometry) -> str:
    if not jumped:
        return ""
    mistaken = (
        "the track is wrong there, by what moved or repeated: record with more of what stands still"
    )
    return (
        f"{len(jumped)} motions from frame to frame are faster than a camera is carried, within"
        f" {_within(jumped, odometry)}; {_advice(odometry, mistaken)}"
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
