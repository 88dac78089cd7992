"""Maps are built, extended and drawn."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from os import PathLike
from pathlib import Path

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
from vnav.config import Config
from vnav.core.progress import Progress, silent
from vnav.core.report import Failed, Report
from vnav.core.trajectory import Trajectory
from vnav.errors import CaptureError
from vnav.io.sources.capture import Capture
from vnav.io.store.map_folder import MapFolder
from vnav.io.store.map_lock import only_writer
from vnav.io.store.replacement import draft_of
from vnav.pipeline.build import BuiltMap, build, expect_captures
from vnav.pipeline.joining import track_alone


@dataclass(frozen=True)
class BuildTask:
    """The arguments of `build_map`, as plain values that another process can be given."""

    capture: Path
    map_dir: Path
    config: Config
    camera: Path | None = None
    trajectory: Path | None = None
    fresh: bool = False
    force: bool = False

    @property
    def name(self) -> str:
        """Name of the capture's folder."""
        return self.capture.resolve().name


def open_capture(
    folder: AnyPath, *, config: ConfigSource = None, camera: AnyPath | None = None
) -> Capture:
    """The capture in a folder; ``camera``: a camera.toml, where the folder has none.

    CaptureError or CameraError where there is none, or no camera of it.
    """
    return capture_of(folder, config_of(config), camera)


def build_map(
    captures: CaptureSource | Sequence[CaptureSource],
    map_dir: AnyPath = "map",
    *,
    config: ConfigSource = None,
    camera: AnyPath | None = None,
    trajectory: TrajectorySource | None = None,
    fresh: bool = False,
    force: bool = False,
    jobs: int = 0,
    scheduler: str = "",
    progress: Progress = silent,
) -> Map:
    """Make a map of a capture: a folder, or frames from anywhere (see `vnav.frames`).

    Several captures of one place make one map; odometry of each is shared out by ``jobs`` and
    ``scheduler`` as `vnav.batch.run` has them. Stages that are up to date are kept; ``fresh``
    deletes the map that is there first. ``camera``: a camera.toml, where a folder has none.
    ``trajectory``: poses to build one capture on as they are, camera to world, or a TUM file of
    them. ``force`` goes on where depth units look wrong. VnavError where there is no map to be
    made; what was finished is kept.
    """
    from vnav import batch

    settings = config_of(config)
    sources = [capture_of(capture, settings, camera) for capture in _listed(captures)]
    given = None if trajectory is None else trajectory_of(trajectory)
    _require_captures(len(sources), given)
    root = Path(map_dir)
    track_all = partial(batch.run, track_alone, jobs=jobs, scheduler=scheduler, progress=progress)
    with only_writer(root):
        built = build(
            sources,
            root,
            settings,
            track_all,
            given=given,
            fresh=fresh,
            force=force,
            progress=progress,
        )
        return _drawn(root, built)


def _listed(captures: CaptureSource | Sequence[CaptureSource]) -> list[CaptureSource]:
    """One or several as a list; folders so that another process finds them, too."""
    if isinstance(captures, str | PathLike):
        return [Path(captures).absolute()]
    if isinstance(captures, Sequence):
        return [capture for several in captures for capture in _listed(several)]
    return [captures]


def _require_captures(count: int, given: Trajectory | None) -> None:
    """CaptureError where there is no capture, or poses are given for several."""
    if not count:
        raise CaptureError("expected a capture to make a map of, found none; name at least one")
    if given is not None and count > 1:
        raise CaptureError(
            f"expected one capture with a trajectory, found {count}: a trajectory is of one clock;"
            " make a map of each"
        )


def build_maps(
    tasks: Sequence[BuildTask],
    *,
    jobs: int = 0,
    scheduler: str = "",
    progress: Progress = silent,
) -> Iterator[tuple[BuildTask, BuiltMap | Failed]]:
    """Make several maps, as `vnav.batch.run` shares work out; each task with what came of it."""
    from vnav import batch

    results = batch.run(build_task, tasks, jobs=jobs, scheduler=scheduler, progress=progress)
    return ((tasks[k], result) for k, result in results)


def build_task(task: BuildTask, progress: Progress = silent) -> BuiltMap:
    """`build_map` for another process: what it found, not the map itself."""
    made = build_map(
        task.capture,
        task.map_dir,
        config=task.config,
        camera=task.camera,
        trajectory=task.trajectory,
        fresh=task.fresh,
        force=task.force,
        progress=progress,
    )
    assert made.built is not None
    return made.built


def extend_map(
    map_dir: AnyPath,
    capture: CaptureSource,
    *,
    config: ConfigSource = None,
    camera: AnyPath | None = None,
    force: bool = False,
    progress: Progress = silent,
) -> Map:
    """Add another capture of the same place to a finished map.

    ``config``: None for the settings that the map was made with. The map is untouched until the
    new one is finished. CaptureError where the capture shows another place.
    """
    from vnav.pipeline.extend import extend, made_with

    folder = MapFolder.open(Path(map_dir))
    settings = made_with(folder) if config is None else config_of(config)
    source = capture_of(capture, settings, camera)
    with only_writer(folder.root), only_writer(draft_of(folder)):
        built = extend(folder, source, settings, force=force, progress=progress)
        return _drawn(folder.root, built)


def track_capture(
    capture: CaptureSource,
    map_dir: AnyPath = "map",
    *,
    config: ConfigSource = None,
    camera: AnyPath | None = None,
    trajectory: TrajectorySource | None = None,
    progress: Progress = silent,
) -> Report:
    """Run the stage odometry alone; arguments as for `build_map`."""
    from vnav.stages import odometry

    settings = config_of(config)
    source = capture_of(capture, settings, camera)
    given = None if trajectory is None else trajectory_of(trajectory)
    with only_writer(Path(map_dir)):
        folder = MapFolder.create(Path(map_dir))
        expect_captures(folder, [source])
        return odometry.run(folder, source, settings, given=given, progress=progress)


def run_stage(
    stage: str,
    map_dir: AnyPath = "map",
    *,
    config: ConfigSource = None,
    progress: Progress = silent,
) -> Report:
    """Run one of the stages after odometry on a map that exists, up to date or not."""
    settings, root = config_of(config), Path(map_dir)
    MapFolder.open(root)
    with only_writer(root):
        folder = MapFolder.create(root)
        module = import_module(f"vnav.stages.{stage}")
        report: Report = module.run(folder, settings, progress=progress)
        if stage == "fuse":
            _draw(folder)
        return report


def _drawn(root: Path, built: BuiltMap) -> Map:
    folder = MapFolder.open(root)
    _draw(folder)
    return Map(folder, built)


def _draw(folder: MapFolder) -> None:
    from vnav.reporting import map_pictures

    map_pictures.draw(folder)
