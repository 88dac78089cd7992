"""A second capture of the same place, joined to a map: located, tracked, optimised together."""

import dataclasses
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vnav.config import Config, updated
from vnav.core import se3
from vnav.core.frame import Edge
from vnav.core.mapping import LOST, FrameTable, Odometry
from vnav.core.progress import Progress, silent
from vnav.core.report import Report
from vnav.errors import CaptureError, ConfigError, MapError
from vnav.io.artifacts import (
    add_keyframes,
    load_loop_edges,
    load_loops,
    load_odometry,
    load_optimised,
    map_camera,
    save_odometry,
)
from vnav.io.capture import Capture
from vnav.io.map_folder import STAGES, MapFolder
from vnav.io.replacement import replacing
from vnav.stages.build_map import run_stages, whole
from vnav.stages.check import require_usable
from vnav.stages.common import clock, finished, reused, settings_of
from vnav.stages.odometry import described, report, track
from vnav.stages.recognise import AGREEING, Recognised, recognise

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Extended:
    """What is doubtful about the new capture, and the reports of the stages of the whole map."""

    warnings: tuple[str, ...]
    reports: list[Report]


def extend(
    folder: MapFolder,
    capture: Capture,
    config: Config,
    *,
    force: bool = False,
    progress: Progress = silent,
) -> Extended:
    """Join a capture to a finished map, which stays as it is until that is done.

    What was mapped before is not tracked again; loops, poses and all that follows are those of all
    captures together, in the world that the map had. CaptureError where the capture does not show
    the place of the map, or its loops disagree with where its keyframes were located.
    """
    started = clock()
    _require_fit(folder, capture, config)
    checked = require_usable(capture, force=force, progress=progress)
    with replacing(folder) as draft:
        tracked = _track(folder, draft, capture, config, progress)
        both = load_odometry(draft)
        seen = recognise(folder, both, map_camera(draft, -1), config, progress)
        _require_seen(seen, folder, capture)
        posed = run_stages(draft, ("vocabulary", "loops", "optimise"), config, progress)
        joined = _joined(draft, both, seen)
        _require_joined(joined, folder, capture)
        reports = [tracked, *posed, *run_stages(draft, ("fuse", "index"), config, progress)]
        current = folder.current()
        if current is not None:  # its world is kept
            draft.write_current(current)
        reports.append(finished(draft, _report(joined, whole(draft)), started))
    return Extended(checked.warnings, reports)


def made_with(folder: MapFolder) -> Config:
    """The settings that a map was made with, but how its captures were read.

    StaleArtifact or MapError where the map is not finished, or of another version.
    """
    folder.require_finished()
    changes = {name: value for stage in STAGES for name, value in folder.settings(stage).items()}
    changes.pop("capture", None)
    return updated(Config(), changes, f"the stages of {folder.root}")


def _require_fit(folder: MapFolder, capture: Capture, config: Config) -> None:
    """MapError, ConfigError or CaptureError where the capture cannot be joined to such a map."""
    made = made_with(folder)
    if load_odometry(folder).given:
        raise MapError(
            f"expected a map whose poses vnav tracked, found one built on given poses in"
            f" {folder.root}; map its capture without --trajectory, and extend that"
        )
    if config.features != made.features:
        raise ConfigError(
            f"expected the features that {folder.root} was made with, found other settings of"
            " [features]; features of two kinds cannot be matched"
        )
    fingerprint = capture.fingerprint()
    for mapped in folder.captures:
        if mapped["fingerprint"] == fingerprint:
            raise CaptureError(
                f"expected a capture that is not in {folder.root} yet, found {capture.name}, which"
                f" is its capture {mapped['id']}; give another"
            )


def _track(
    folder: MapFolder, draft: MapFolder, capture: Capture, config: Config, progress: Progress
) -> Report:
    """The odometry stage of the extended map: that of the old one, and of the new capture."""
    started = clock()
    settings = settings_of(config, "capture", "features", "registration", "odometry")
    captures = [*folder.captures, described(len(folder.captures), capture)]
    inputs = {f"capture_{c['id']}": c["fingerprint"] for c in captures}
    before = folder.inputs_of("odometry", "optimise")
    inputs |= {f"{stage}_before": digest for stage, digest in before.items()}
    if draft.is_current("odometry", settings, inputs):
        return reused(draft, "odometry")
    with draft.writing("odometry", settings, inputs) as path:
        both = _appended(folder, path, capture, config, progress)
        save_odometry(path, both)
        draft.set_captures(captures)
    return finished(draft, report(both), started)


def _appended(
    folder: MapFolder, path: Path, capture: Capture, config: Config, progress: Progress
) -> Odometry:
    """The odometry of both, its keyframes' images in the folder ``path``."""
    old, T_world_camera = load_odometry(folder), load_optimised(folder).T_world_camera
    added = path / "added"
    added.mkdir()
    new = track([capture], config, added, progress)
    shutil.copytree(folder.stage("odometry") / "keyframes", path / "keyframes")
    add_keyframes(path, added, len(old.frames))
    shutil.rmtree(added)
    return append(old, new, T_world_camera)


def append(old: Odometry, new: Odometry, T_world_camera: Array) -> Odometry:
    """Two odometries as one, which nothing joins yet; ``T_world_camera`` (N, 4, 4): the old's."""
    rows, segments = len(old.frames), int(old.segment.max()) + 1
    captures = int(old.frames.capture[-1]) + 1
    nowhere = np.full((len(new.frames), 4, 4), np.nan)
    return Odometry(
        FrameTable(
            np.concatenate([old.frames.capture, new.frames.capture + captures]),
            np.concatenate([old.frames.index, new.frames.index]),
            np.concatenate([old.frames.stamp_s, new.frames.stamp_s]),
        ),
        np.concatenate([old.T_segment_camera, new.T_segment_camera]),
        np.append(old.segment, np.where(new.segment == LOST, LOST, new.segment + segments)),
        old.reasons + new.reasons,
        old.edges + tuple(_moved(edge, rows) for edge in new.edges),
        old.keyframes + tuple(dataclasses.replace(k, row=k.row + rows) for k in new.keyframes),
        T_world_before=np.concatenate([T_world_camera, nowhere]),
    )


def _moved(edge: Edge, rows: int) -> Edge:
    return Edge(edge.i + rows, edge.j + rows, edge.T_i_j, edge.information)


def _require_seen(seen: Recognised, folder: MapFolder, capture: Capture) -> None:
    """CaptureError where too few keyframes were located, or in places that do not agree."""
    if seen.agreeing >= AGREEING:
        return
    best = ""
    if seen.best:
        best = f"; the best of the others: {seen.best.reason}, {seen.best.inliers} inliers"
    raise CaptureError(
        f"expected {capture.name} to show the place of the map {folder.root}, found {len(seen)} of"
        f" {seen.asked} keyframes in it, {seen.agreeing} of which agree where {AGREEING} are needed"
        f"{best}; the map is as it was. Record more of what it shows, or make a map of its own with"
        " 'vnav build-map'"
    )


@dataclass(frozen=True)
class Joined:
    """What became of a new capture.

    Of its ``frames``, those ``posed``; of its keyframes ``asked``, those ``located`` in the map
    before; ``closures`` kept with what was mapped before, and how many put it where it was located.
    """

    frames: int
    posed: int
    asked: int
    located: int
    closures: int
    borne_out: int


def _joined(draft: MapFolder, both: Odometry, seen: Recognised) -> Joined:
    before, is_new = both.T_world_before, both.frames.capture == both.frames.capture[-1]
    assert before is not None
    across = [e for e in _kept(draft) if np.isfinite(before[e.i, 0, 0]) and is_new[e.j]]
    T_world_segment = np.array(
        [before[e.i] @ e.T_i_j @ se3.inverse(both.T_segment_camera[e.j]) for e in across]
    ).reshape(-1, 4, 4)
    borne_out = seen.bears_out(both.segment[[e.j for e in across]], T_world_segment)
    posed = np.isfinite(load_optimised(draft).T_world_camera[is_new, 0, 0])
    counts = len(posed), int(posed.sum()), seen.asked, len(seen)
    return Joined(*counts, len(across), int(borne_out.sum()))


def _kept(folder: MapFolder) -> list[Edge]:
    """The closures that the pose graph bore out."""
    edges, _ = load_loop_edges(folder)
    found, judged = load_loops(folder, "loops"), load_loops(folder, "optimise")
    accepted = [late for early, late in zip(found, judged, strict=True) if early.accepted]
    return [e for e, verdict in zip(edges, accepted, strict=True) if verdict.accepted]


def _require_joined(joined: Joined, folder: MapFolder, capture: Capture) -> None:
    """CaptureError where no loop joins the capture there where its keyframes were located."""
    if joined.posed and joined.borne_out >= AGREEING:
        return
    raise CaptureError(
        f"expected loops that join {capture.name} to the map {folder.root} where {joined.located}"
        f" of its keyframes were located, found {joined.closures}, of which {joined.borne_out}"
        " agree with that; the map is as it was. Record more of what it shows"
    )


def _report(joined: Joined, whole_map: Report) -> Report:
    """The report of the whole map, and of how it was extended."""
    lines = (
        f"{joined.posed} of {joined.frames} frames joined to the map by {joined.closures} loops;"
        f" {joined.located} of {joined.asked} keyframes asked were located in it",
        *whole_map.lines,
    )
    values = whole_map.values | {"joined": vars(joined)}
    return dataclasses.replace(whole_map, values=values, lines=lines)
