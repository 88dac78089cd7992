"""A second capture of the same place, joined to a map: located, tracked, optimised together."""

import dataclasses

from vnav.checking.capture_report import require_usable
from vnav.config import Config, updated
from vnav.core.progress import Progress, silent
from vnav.errors import CaptureError, ConfigError, MapError
from vnav.io.sources.capture import Capture
from vnav.io.store.artifacts import load_odometry, map_camera
from vnav.io.store.map_folder import STAGES, MapFolder
from vnav.io.store.records import MappedCapture
from vnav.io.store.replacement import replacing
from vnav.io.store.stage_reports import clock, finished
from vnav.pipeline.build import BuiltMap, expect_scale, judged, run_stages, whole
from vnav.pipeline.connection import (
    connection,
    require_connection,
    require_same_place,
    with_connection,
)
from vnav.pipeline.joining import in_turn, track_together
from vnav.pipeline.relocalise import relocalise
from vnav.stages.odometry import described
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
        entries, alone = [*folder.captures, entry], in_turn(progress)
        odometry = track_together(draft, [capture], entries, config, alone, folder)
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
