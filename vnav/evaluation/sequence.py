"""One run of one sequence of a suite: map it, score the map, locate its photos."""

import dataclasses
import os
import platform
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vnav import __version__
from vnav.checking.capture_report import require_usable
from vnav.config import Config, load
from vnav.core.arrays import Array
from vnav.core.association import associate
from vnav.core.camera import Intrinsics
from vnav.core.progress import Progress, silent
from vnav.core.report import Report
from vnav.core.trajectory import Trajectory
from vnav.errors import CaptureError
from vnav.evaluation import relocalisation
from vnav.evaluation.score import score
from vnav.io.datasets.suite_file import Entry, SequenceFiles, Suite, files_of
from vnav.io.sources.capture import FileBacked
from vnav.io.sources.folder_capture import FolderCapture
from vnav.io.sources.open_capture import open_capture, read_truth
from vnav.io.store.artifacts import load_loops, load_odometry, load_trajectory
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.overview import overview
from vnav.pipeline.build import build_map
from vnav.stages.locate import Locator

MAX_DIFFERENCE_S = 0.02  # between a pose and its true one, as the TUM benchmark has it
OF_THE_MAP = ("frames", "tracked", "posed", "keyframes", "lost", "loops", "landmarks", "path_m")
UNKNOWN = Trajectory(np.zeros(0), np.zeros((0, 4, 4)))
# Name, camera of all photos, photos.
QuerySet = tuple[str, Intrinsics | None, list[relocalisation.PosedPhoto]]


@dataclass(frozen=True)
class SequenceTask:
    """A sequence, and all that its result depends on; the seed is the configuration's."""

    entry: Entry
    suite_folder: Path
    config: Config

    @property
    def name(self) -> str:
        """For people."""
        return f"{self.entry.name}, seed {self.config.seed}"

    def asked(self) -> dict[str, Any]:
        """What tells this run from others, as plain values."""
        entry = dataclasses.asdict(self.entry)
        del entry["peers"]
        return {
            "vnav": __version__,
            "suite_folder": str(self.suite_folder),
            "sequence": entry,
            "config": dataclasses.asdict(self.config),
        }


@dataclass(frozen=True)
class SequenceRun:
    """What came out.

    ``values``, for JSON: docs/evaluating.md names them; ``trajectory``: the map's, in its own
    world; ``truth``: the true poses of its frames, empty without a truth; ``closures_s`` (L, 2):
    times of the two keyframes of each accepted loop.
    """

    values: dict[str, Any]
    trajectory: Trajectory
    truth: Trajectory
    closures_s: Array


def tasks(
    suite: Suite, seeds: int, source: str | None, settings: Iterable[str]
) -> list[SequenceTask]:
    """Every run of a suite: each sequence with its own settings, then those given, and seeds.

    ConfigError where a setting is wrong, before anything is run.
    """
    found = []
    for entry in suite.entries:
        config = load(source, settings, suite.config_of(entry))
        for seed in range(config.seed, config.seed + seeds):
            found.append(SequenceTask(entry, suite.folder, dataclasses.replace(config, seed=seed)))
    return found


def evaluate(task: SequenceTask, progress: Progress = silent) -> SequenceRun:
    """Map a sequence, score the map's trajectory, locate its photos and held-out frames.

    The map lies in a temporary folder. VnavError where a file is missing, or there is no map or no
    score to be had.
    """
    entry, config = task.entry, task.config
    files = files_of(entry, task.suite_folder)
    capture = open_capture(files.capture, config.capture, files.camera)
    truth = _truth(files, capture, config)
    queries = _queries(task, files, capture, truth)
    with tempfile.TemporaryDirectory() as scratch:
        folder = MapFolder.create(Path(scratch) / "map")
        mapped = relocalisation.without_held_out(capture, entry.hold_out_every)
        require_usable(capture, progress=progress)
        reports = build_map(folder, mapped, config, progress=progress)
        trajectory = load_trajectory(folder)
        values = _of_the_map(folder, reports)
        if len(truth):
            scored = score(trajectory, truth, MAX_DIFFERENCE_S)
            values["score"] = scored.as_dict()
            for name, camera, photos in queries:
                values["relocalisation"][name] = relocalisation.relocalise(
                    Locator.open(folder, config, camera), photos, scored.ate.T_truth_world, progress
                )
        return SequenceRun(values, trajectory, _true_poses(trajectory, truth), _closures_s(folder))


def _truth(files: SequenceFiles, capture: FileBacked, config: Config) -> Trajectory:
    """The true trajectory, empty where there is none."""
    if files.truth is None and capture.truth is None:
        return UNKNOWN
    return read_truth(files.truth or files.capture, config.capture, files.camera)


def _queries(
    task: SequenceTask, files: SequenceFiles, capture: FolderCapture, truth: Trajectory
) -> list[QuerySet]:
    """The photos of a sequence; CaptureError where they have no truth to be held against."""
    entry, found = task.entry, list[QuerySet]()
    if files.queries:
        found.append(("photos", None, relocalisation.photo_queries(files.queries)))
    if entry.hold_out_every:
        frames = relocalisation.held_out_queries(
            capture, entry.hold_out_every, truth, MAX_DIFFERENCE_S
        )
        found.append(("held-out frames", capture.camera.color, frames))
    if found and not len(truth):
        raise CaptureError(
            f"expected a true trajectory of {files.capture}, to align the map before photos are"
            " scored, found none; name it with 'truth', or leave out 'queries'"
        )
    return found


def _of_the_map(folder: MapFolder, reports: Sequence[Report]) -> dict[str, Any]:
    found = overview(folder)
    whole = next(report for report in reports if report.stage == "map")
    return {name: found[name] for name in OF_THE_MAP} | {
        "seconds": {r.stage: {"wall": r.seconds, "cpu": r.cpu_seconds} for r in reports},
        "peak_memory_mb": whole.values["peak_memory_mb"],
        "map_mb": whole.values["map_mb"],
        "host": platform.node(),
        "cores": os.cpu_count(),
        "score": None,
        "relocalisation": {},
    }


def _true_poses(trajectory: Trajectory, truth: Trajectory) -> Trajectory:
    """The true poses that belong to those of the map, at the map's times."""
    matches = associate(trajectory.stamps_s, truth.stamps_s, MAX_DIFFERENCE_S)
    return Trajectory(trajectory.stamps_s[matches[:, 0]], truth.T_world_camera[matches[:, 1]])


def _closures_s(folder: MapFolder) -> Array:
    odometry = load_odometry(folder)
    stamps_s = odometry.frames.stamp_s[[keyframe.row for keyframe in odometry.keyframes]]
    pairs = [(v.i, v.j) for v in load_loops(folder) if v.accepted and v.is_loop]
    return np.asarray(stamps_s[np.array(pairs, int).reshape(-1, 2)])
