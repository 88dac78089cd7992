"""A second capture of the same place, joined to a map: located, tracked, optimised together."""

import dataclasses

import numpy as np

from vnav.checking.capture_report import require_usable
from vnav.config import Config, updated
from vnav.core.arrays import Array
from vnav.core.progress import Progress, silent
from vnav.core.report import Report
from vnav.errors import CaptureError, ConfigError, MapError
from vnav.io.sources.capture import Capture
from vnav.io.store.artifacts import (
    load_odometry,
    load_optimised,
    map_camera,
    save_odometry,
)
from vnav.io.store.map_folder import STAGES, MapFolder
from vnav.io.store.records import MappedCapture
from vnav.io.store.replacement import replacing
from vnav.io.store.stage_reports import clock, finished, reused, settings_of
from vnav.pipeline.build import BuiltMap, expect_scale, judged, run_stages, whole
from vnav.pipeline.connection import (
    connection,
    require_connection,
    require_same_place,
    with_connection,
)
from vnav.pipeline.joining import in_turn, joined_odometry, tracked
from vnav.pipeline.relocalise import relocalise
from vnav.stages.odometry import SECTIONS, described, report
from vnav.threads import one_blas_thread


@one_blas_thread
def extend(
    folder: MapFolder,
    capture: Capture,
    config: Config,
    *,
    force: bool = False,
    progress: Progress = silent,
) -> BuiltMap:
    """Join a capture to a finished map, which stays as it is until that is done.

    What was mapped before is not tracked again; loops, poses and all that follows are those of all
    captures together, in the world that the map had. CaptureError where the capture does not show
    the place of the map, or its loops disagree with where its keyframes were located.
    """
    started = clock()
    expect_scale(config)
    entry = described(len(folder.captures), capture)
    _require_compatible(folder, entry, config)
    checked = require_usable(capture, force=force, progress=progress)
    with replacing(folder) as draft:
        draft.set_captures([*folder.captures, entry])
        odometry = _odometry(folder, draft, capture, config, progress)
        both = load_odometry(draft)
        located = relocalise(folder, both, map_camera(draft, -1), config, progress)
        require_same_place(located, capture.name, folder)
        posed = run_stages(draft, ("vocabulary", "loops", "optimise"), config, progress)
        found = connection(draft, both, located)
        require_connection(found, capture.name, folder)
        reports = [odometry, *posed, *run_stages(draft, ("fuse", "index"), config, progress)]
        current = folder.current()
        if current is not None:  # its world is kept
            draft.write_current(current)
        reports.append(finished(draft, with_connection(whole(draft), found), started))
        reports.append(judged(draft, config))
    return BuiltMap(checked.warnings, reports)


def made_with(folder: MapFolder) -> Config:
    """The settings that a map was made with, but how its captures were read.

    StaleArtifact or MapError where the map is not finished, or of another version.
    """
    folder.require_finished()
    recorded = (item for stage in STAGES for item in folder.settings(stage).items())
    sections = {field.name for field in dataclasses.fields(Config)} - {"capture"}
    changes = {name: value for name, value in recorded if name in sections}
    return updated(Config(), changes, f"the stages of {folder.root}")


def _require_compatible(folder: MapFolder, entry: MappedCapture, config: Config) -> None:
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
    for mapped in folder.captures:
        if mapped["fingerprint"] == entry["fingerprint"]:
            raise CaptureError(
                f"expected a capture that is not in {folder.root} yet, found {entry['name']}, which"
                f" is its capture {mapped['id']}; give another"
            )


def _odometry(
    folder: MapFolder, draft: MapFolder, capture: Capture, config: Config, progress: Progress
) -> Report:
    """The odometry stage of the extended map: that of the old one, and of the new capture."""
    started = clock()
    settings = settings_of(config, *SECTIONS)
    inputs = {f"capture_{c['id']}": c["fingerprint"] for c in draft.captures}
    before = folder.inputs_of("odometry", "optimise")
    inputs |= {f"{stage}_before": digest for stage, digest in before.items()}
    if draft.is_current("odometry", settings, inputs):
        return reused(draft, "odometry")
    with (
        tracked(draft, [capture], config, in_turn(progress)) as new,
        draft.writing("odometry", settings, inputs) as path,
    ):
        both = joined_odometry(path, [folder, *new])
        T_world_before = _world_before(folder, len(both.frames))
        both = dataclasses.replace(both, T_world_before=T_world_before)
        save_odometry(path, both)
    return finished(draft, report(both), started)


def _world_before(folder: MapFolder, count: int) -> Array:
    """Poses (N, 4, 4) of all frames as the old map has them: NaN for those of the new capture."""
    poses = np.full((count, 4, 4), np.nan)
    known = load_optimised(folder).T_world_camera
    poses[: len(known)] = known
    return poses
