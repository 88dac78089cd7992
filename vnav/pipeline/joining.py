"""Captures of one place, each tracked alone; then their odometries are put behind each other."""

import dataclasses
import logging
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path

import numpy as np

from vnav.config import Config
from vnav.core.frame import Edge
from vnav.core.mapping import LOST, FrameTable, Odometry
from vnav.core.progress import Progress, silent
from vnav.core.report import Failed, Report
from vnav.errors import CaptureError
from vnav.io.sources.capture import Capture
from vnav.io.store.artifacts import copy_keyframes, load_odometry, load_optimised, save_odometry
from vnav.io.store.map_folder import PARTS, MapFolder
from vnav.io.store.records import MappedCapture
from vnav.io.store.stage_reports import clock, finished, reused, settings_of
from vnav.stages import odometry

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class TrackTask:
    """Odometry of one capture of several, in a map folder of its own."""

    capture: Capture
    place: Path
    config: Config

    @property
    def name(self) -> str:
        """That of the capture."""
        return self.capture.name


TrackAll = Callable[[Sequence[TrackTask]], Iterable[tuple[int, Report | Failed]]]


def track_alone(task: TrackTask, progress: Progress = silent) -> Report:
    """The stage odometry of one capture; what is up to date is kept."""
    folder = MapFolder.create(task.place)
    return odometry.run(folder, task.capture, task.config, progress=progress)


def in_turn(progress: Progress) -> TrackAll:
    """Track captures in this process, one after the other."""
    return lambda tasks: ((k, track_alone(task, progress)) for k, task in enumerate(tasks))


def track_together(
    folder: MapFolder,
    captures: Sequence[Capture],
    entries: Sequence[MappedCapture],
    config: Config,
    track_all: TrackAll,
    before: MapFolder | None = None,
) -> Report:
    """The stage odometry of several captures; the last are tracked, each alone.

    ``entries`` lists all captures of the map; ``before``: the map that has the first ones, whose
    world is kept.
    """
    started = clock()
    settings = settings_of(config, *odometry.SECTIONS)
    inputs = {f"capture_{entry['id']}": entry["fingerprint"] for entry in entries}
    if before is not None:
        of_before = before.inputs_of("odometry", "optimise")
        inputs |= {f"{stage}_before": digest for stage, digest in of_before.items()}
    if folder.is_current("odometry", settings, inputs):
        forget_parts(folder)
        return reused(folder, "odometry")
    with (
        _tracked(folder, captures, config, track_all) as parts,
        folder.writing("odometry", settings, inputs) as draft,
    ):
        joined = _joined(draft, parts if before is None else [before, *parts])
        if before is not None:
            joined = _in_world_of(before, joined)
        save_odometry(draft, joined)
        folder.set_captures(entries)
    return finished(folder, odometry.report(joined), started)


@contextmanager
def _tracked(
    folder: MapFolder, captures: Sequence[Capture], config: Config, track_all: TrackAll
) -> Iterator[list[MapFolder]]:
    """For each capture a folder with its odometry, within a map's; gone when the block ends.

    An interruption leaves those that are finished for the next time, and so does a capture that
    cannot be tracked, for which CaptureError is raised after the others.
    """
    place = folder.root.absolute() / PARTS  # for processes elsewhere
    tasks = [TrackTask(c, place / f"{k:03d}", config) for k, c in enumerate(captures)]
    for k, result in sorted(track_all(tasks), key=itemgetter(0)):
        if isinstance(result, Failed):
            if result.traceback:
                log.error(result.traceback)
            raise CaptureError(f"{tasks[k].name}: {result.reason}")
    yield [MapFolder.open(task.place) for task in tasks]
    forget_parts(folder)


def forget_parts(folder: MapFolder) -> None:
    """Remove the folders in which captures of a map were tracked, now that it has odometry."""
    shutil.rmtree(folder.root / PARTS, ignore_errors=True)


def _joined(draft: Path, parts: Sequence[MapFolder]) -> Odometry:
    """The odometry of several, which nothing joins yet; keyframes' images are put in the draft."""
    first, *others = parts
    joined = load_odometry(first)
    copy_keyframes(first, draft)
    for part in others:
        copy_keyframes(part, draft, len(joined.frames))
        joined = _behind(joined, load_odometry(part))
    return joined


def _behind(old: Odometry, new: Odometry) -> Odometry:
    """One odometry behind the other; where the old was in a world is left out."""
    rows, segments = len(old.frames), int(old.segment.max()) + 1
    captures = int(old.frames.capture[-1]) + 1
    return Odometry(
        FrameTable(
            np.concatenate([old.frames.capture, new.frames.capture + captures]),
            np.concatenate([old.frames.index, new.frames.index]),
            np.concatenate([old.frames.stamp_s, new.frames.stamp_s]),
            np.concatenate([old.frames.depth_after_s, new.frames.depth_after_s]),
        ),
        np.concatenate([old.T_segment_camera, new.T_segment_camera]),
        np.append(old.segment, np.where(new.segment == LOST, LOST, new.segment + segments)),
        old.reasons + new.reasons,
        old.edges + _shifted(new.edges, rows),
        old.keyframes + tuple(dataclasses.replace(k, row=k.row + rows) for k in new.keyframes),
        degenerate_edges=old.degenerate_edges + _shifted(new.degenerate_edges, rows),
        alternatives=old.alternatives + _shifted(new.alternatives, rows),
        moving_share=np.concatenate([old.moving_share, new.moving_share]),
        light=np.concatenate([old.light, new.light]),
    )


def _in_world_of(before: MapFolder, joined: Odometry) -> Odometry:
    """With the poses that the first frames had in a map's world; NaN for the others."""
    poses = np.full((len(joined.frames), 4, 4), np.nan)
    known = load_optimised(before).T_world_camera
    poses[: len(known)] = known
    return dataclasses.replace(joined, T_world_before=poses)


def _shifted(edges: Iterable[Edge], rows: int) -> tuple[Edge, ...]:
    return tuple(dataclasses.replace(edge, i=edge.i + rows, j=edge.j + rows) for edge in edges)
