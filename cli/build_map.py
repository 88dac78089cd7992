"""Make maps of captures."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from vnav.cli.options import (
    batch_options,
    config_options,
    console_progress,
    map_option,
    require_one_way,
)
from vnav.cli.say import say
from vnav.cli.summary import show_map

if TYPE_CHECKING:
    from vnav.api.building import BuildTask
    from vnav.core.report import Failed
    from vnav.pipeline.build import BuiltMap

capture_argument = click.argument("capture_dir", metavar="CAPTURE", type=click.Path(path_type=Path))
camera_option = click.option(
    "--camera",
    "camera_file",
    type=click.Path(path_type=Path),
    help="Camera of the capture: a camera.toml, or a file of Open3D, ROS, COLMAP, Record3D, NeRF.",
)
trajectory_option = click.option(
    "--trajectory",
    "trajectory_file",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="Poses to build on as they are: TUM lines, camera to world, z up, the capture's clock; or"
    " a phone's folder that holds its own.",
)


@click.command("build-map")
@click.argument(
    "captures", metavar="CAPTURE...", nargs=-1, required=True, type=click.Path(path_type=Path)
)
@map_option
@click.option(
    "--maps",
    "maps_dir",
    metavar="DIR",
    type=click.Path(path_type=Path),
    help="Make a map of each capture, in this folder, called as the capture.",
)
@config_options
@camera_option
@trajectory_option
@click.option("--fresh", is_flag=True, help="Delete the map that is there and start anew.")
@click.option("--force", is_flag=True, help="Go on although the depth units look wrong.")
@batch_options
def build_map(
    captures: tuple[Path, ...],
    map_dir: Path,
    maps_dir: Path | None,
    config_source: str | None,
    settings: tuple[str, ...],
    camera_file: Path | None,
    trajectory_file: Path | None,
    fresh: bool,
    force: bool,
    jobs: int | None,
    scheduler: str,
) -> int:
    """Make a map of the RGB-D frames in the folder CAPTURE.

    Several captures of one place make one map: each is tracked alone, and loops join them. One that
    nothing joins is named. With --maps each capture gets a map of its own.

    Stages that are up to date are kept. An interrupted run goes on with the stage that it was in,
    from its beginning.

    Exit code 1: a capture could not be mapped; with --maps the others are mapped all the same.

    \b
    vnav build-map my_capture --map my-map
    vnav build-map ground-floor stairs first-floor --map building
    vnav build-map monday tuesday --maps maps --jobs 2
    """
    from vnav import config
    from vnav.api.building import BuildTask

    require_one_way(jobs, scheduler)
    if len(captures) > 1 and trajectory_file is not None:
        raise click.UsageError("expected one CAPTURE with --trajectory, found several")
    paths = [capture.absolute() for capture in captures]
    resolved, camera = config.load(config_source, settings), camera_file and camera_file.absolute()
    given = trajectory_file and trajectory_file.absolute()
    where, names = (map_dir, [""] * len(paths)) if maps_dir is None else (maps_dir, _names(paths))
    tasks = [
        BuildTask(path, (where / name).absolute(), resolved, camera, given, fresh, force)
        for path, name in zip(paths, names, strict=True)
    ]
    is_one_map = len(tasks) > 1 and maps_dir is None
    return (_built_together if is_one_map else _built_alone)(tasks, jobs or 0, scheduler)


def _built_together(tasks: "Sequence[BuildTask]", jobs: int, scheduler: str) -> int:
    """One map of the captures of all tasks."""
    from vnav.api.building import build_map

    first, captures, progress = tasks[0], [task.capture for task in tasks], console_progress()
    made = build_map(
        captures,
        first.map_dir,
        config=first.config,
        camera=first.camera,
        fresh=first.fresh,
        force=first.force,
        jobs=jobs,
        scheduler=scheduler,
        progress=progress,
    )
    assert made.built is not None
    show_map(first.map_dir, made.built)
    return 0


def _built_alone(tasks: "Sequence[BuildTask]", jobs: int, scheduler: str) -> int:
    """A map for each task."""
    from vnav.api.building import build_maps

    progress = console_progress()
    results = build_maps(tasks, jobs=jobs, scheduler=scheduler, progress=progress)
    failed = [_failed(task, result, len(tasks) > 1) for task, result in results]
    return int(any(failed))


def _names(captures: Sequence[Path]) -> list[str]:
    """What the map of each capture is called; UsageError where two would be called the same."""
    names = [capture.resolve().name for capture in captures]
    for name in names:
        if names.count(name) > 1:
            raise click.UsageError(f"expected captures of different names, found two {name}")
    return names


def _failed(task: "BuildTask", result: "BuiltMap | Failed", one_of_several: bool) -> bool:
    """Tell what became of a task; whether there is no map."""
    from vnav.core.report import Failed

    if isinstance(result, Failed):
        name = f"{task.name}: " if one_of_several else ""
        for line in (*result.notes, f"{result.traceback}vnav: {name}{result.reason}"):
            say(line, err=True)
        return True
    show_map(task.map_dir, result)
    return False
