"""Captures are checked, trajectories scored, whole suites evaluated."""

import dataclasses
import logging
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from vnav.api.arguments import (
    AnyPath,
    CaptureSource,
    ConfigSource,
    TrajectorySource,
    capture_of,
    config_of,
    trajectory_of,
)
from vnav.api.map import Map
from vnav.config import CaptureConfig, Config
from vnav.core.progress import Progress, silent
from vnav.core.trajectory import Trajectory
from vnav.errors import CaptureError, MapError
from vnav.io.sources.open_capture import read_truth, truth_of
from vnav.io.sources.record3d import is_recording
from vnav.io.store.map_folder import MapFolder

if TYPE_CHECKING:
    from vnav.checking.capture_report import CaptureReport
    from vnav.evaluation.score import Score
    from vnav.evaluation.stored_runs import Outcome
    from vnav.evaluation.tracker_matches import TrackerPair
    from vnav.io.datasets.suite_file import Suite

log = logging.getLogger(__name__)


def check(
    capture: CaptureSource,
    *,
    config: ConfigSource = None,
    camera: AnyPath | None = None,
    picture: AnyPath | None = None,
    progress: Progress = silent,
) -> "CaptureReport":
    """Look at a capture before a map is made of it: every file, times, light, some of the frames.

    ``problems`` of what it gives say what would stop a map. ``picture``: a PNG to draw some frames
    into, with the edges of depth over colour, unless the capture is unfit for other reasons than
    its units. Other arguments as for `build_map`.
    """
    from vnav.checking.capture_report import inspect
    from vnav.lighting.flattened import light_of
    from vnav.overlays.overlay import without_overlay

    settings = config_of(config)
    source = capture_of(capture, settings, camera)
    report = inspect(source, progress=progress)
    if settings.capture.flatten == "auto" and not report.fatal:
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            light = light_of(source, pool, progress)
        report = dataclasses.replace(report, corners=light.corners, bands=light.bands)
    if settings.capture.overlay == "auto" and not report.fatal:
        report = dataclasses.replace(report, overlay=without_overlay(source)[1])
    if picture is not None and not report.fatal:
        from vnav.reporting.depth_picture import draw

        draw(source, Path(picture))
    return report


def score(
    trajectory: TrajectorySource,
    truth: TrajectorySource,
    *,
    max_difference_s: float = 0.02,
    frames: int = 1,
    align: str = "se3",
    camera: AnyPath | None = None,
) -> "Score":
    """ATE and RPE of poses against the true ones, each a trajectory or a TUM file.

    ``trajectory`` may also be the folder of a map of one capture: its final poses, or odometry's
    of the longest segment where there are none. ``truth`` may also be a capture folder that comes
    with its truth, ``camera`` that capture's.
    Poses belong together whose times differ by less than ``max_difference_s``; RPE is taken over
    ``frames`` frames. ``align``: "se3", or "sim3" for a trajectory whose scale is not known.
    TrajectoryError where fewer than three do.
    """
    from vnav.evaluation import score as scoring

    if not isinstance(truth, Trajectory):
        camera_file = None if camera is None else Path(camera)
        truth = read_truth(Path(truth), CaptureConfig(), camera_file)
    return scoring.score(_estimated(trajectory), truth, max_difference_s, frames, align)


def _estimated(source: TrajectorySource) -> Trajectory:
    """The poses to be scored; MapError where they are a map's of several captures."""
    if isinstance(source, Trajectory) or not (Path(source) / "map.json").is_file():
        return trajectory_of(source)
    folder = MapFolder.open(Path(source))
    count = len(folder.captures)
    if count > 1:
        raise MapError(
            f"expected a map of one capture, found {folder.root}, of {count}; name the poses of"
            f" one: {folder.root / 'optimise'}/trajectory_0.tum to trajectory_{count - 1}.tum"
        )
    if folder.recorded("odometry") and not folder.recorded("optimise"):
        from vnav.io.store.artifacts import load_odometry

        return load_odometry(folder, any_scale=True).trajectory
    return Map(folder).trajectory()


def compare_trackers(
    capture: CaptureSource,
    a: int,
    b: int,
    *,
    config: ConfigSource = None,
    camera: AnyPath | None = None,
) -> "TrackerPair":
    """What every tracker finds in frame b of a capture of the points of frame a.

    Held against depth and truth where the capture is a folder that comes with its truth.
    CaptureError where there is no such frame.
    """
    from vnav.evaluation.tracker_matches import match_by_all, true_motion
    from vnav.io.sources.rectify import rectified, resampled

    settings = config_of(config)
    source = capture_of(capture, settings, camera)
    for row in (a, b):
        if not 0 <= row < len(source):
            raise CaptureError(
                f"expected frames 0 to {len(source) - 1} of {source.name}, found {row}"
            )
    step = 1 if b > a else -1
    before = [k for k in (b - 2 * step, b - step) if 0 <= k < len(source)]
    rows = [a, b, *before]
    first, second, *others = (resampled(source.read(k), rectified(source.camera)) for k in rows)
    truth = truth_of_capture(capture, settings, camera)
    T_a_b = true_motion(truth, first.stamp_s, second.stamp_s, settings.capture.association_s)
    return match_by_all(first, second, others, T_a_b, settings)


def truth_of_capture(
    capture: CaptureSource, settings: Config, camera: AnyPath | None
) -> Trajectory | None:
    """The true poses that a folder comes with; None where it has none."""
    if not isinstance(capture, str | PathLike):
        return None
    path, camera_file = Path(capture), None if camera is None else Path(camera)
    if is_recording(path) or truth_of(path, settings.capture) is None:
        return None
    return read_truth(path, settings.capture, camera_file)


def evaluate(
    suite: str,
    out: AnyPath = "evaluation",
    *,
    seeds: int = 1,
    config: str | None = None,
    settings: Sequence[str] = (),
    resume: bool = False,
    jobs: int = 1,
    scheduler: str = "",
    progress: Progress = silent,
) -> "list[Outcome]":
    """Map, score and locate every sequence of a suite, a file or the name of one that ships.

    Each sequence is run with ``seeds`` seeds, its own settings, then those of ``config`` and
    ``settings`` ("odometry.max_depth_m=4"). Writes results.csv, results.json, report.html and the
    trajectories to ``out``; with ``resume`` runs that are there are kept. ``jobs`` and
    ``scheduler`` as for `vnav.batch.run`. A run that fails is an outcome with its reason.
    """
    from vnav import batch
    from vnav.evaluation import sequence, stored_runs
    from vnav.io.datasets.suite_file import read_suite

    asked, folder = read_suite(suite), Path(out)
    tasks = sequence.tasks(asked, seeds, config, settings)
    stored_runs.prepare(folder)
    outcomes = stored_runs.finished_before(folder, tasks) if resume else {}
    if resume:
        log.info("%d of %d runs are there already", len(outcomes), len(tasks))
    todo = [k for k in range(len(tasks)) if k not in outcomes]
    results = batch.run(
        sequence.evaluate,
        [tasks[k] for k in todo],
        jobs=jobs,
        scheduler=scheduler,
        progress=progress,
    )
    for n, result in results:
        outcome = stored_runs.Outcome(tasks[todo[n]], result)
        stored_runs.save(folder, outcome)
        outcomes[todo[n]] = outcome
        log.info("%d of %d runs: %s", len(outcomes), len(tasks), outcome.summary)
    in_order = [outcomes[k] for k in range(len(tasks))]
    _write_results(folder, asked, in_order)
    return in_order


def _write_results(out: Path, suite: "Suite", outcomes: "list[Outcome]") -> None:
    from vnav.evaluation.result_files import as_csv, as_json
    from vnav.evaluation.stored_runs import writing
    from vnav.io.files import write_text
    from vnav.reporting.run_page import page

    with writing(out):
        write_text(out / "results.csv", as_csv(outcomes))
        write_text(out / "results.json", as_json(suite, outcomes))
        write_text(out / "report.html", page(suite, outcomes))
    log.info("report in %s", out / "report.html")
