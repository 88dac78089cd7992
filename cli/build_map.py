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
    help="Camera of the capture, where it has no camera.toml.",
)
trajectory_option = click.option(
    "--trajectory",
    "trajectory_file",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="Poses to build on as they are: TUM lines, camera to world, z up, the capture's clock.",
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
    help="Folder for the maps of several captures; each is called as its capture.",
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
    """Make a map of the RGB-D frames in the folder CAPTURE; of several, one map each.

    Stages that are up to date are kept, so that an interrupted run goes on where it stopped.

    Exit code 1: a capture could not be mapped; the others are mapped all the same.

    \b
    vnav build-map my_capture --map my-map
    vnav build-map monday tuesday --maps maps --jobs 2
    """
    from vnav import config
    from vnav.api.building import BuildTask, build_maps

    require_one_way(jobs, scheduler)
    if len(captures) > 1 and trajectory_file is not None:
        raise click.UsageError("expected one CAPTURE with --trajectory, found several")
    resolved, camera = config.load(config_source, settings), camera_file and camera_file.absolute()
    given = trajectory_file and trajectory_file.absolute()
    tasks = [
        BuildTask(capture.absolute(), place, resolved, camera, given, fresh, force)
        for capture, place in zip(captures, _places(captures, map_dir, maps_dir), strict=True)
    ]
    progress = console_progress()
    results = build_maps(tasks, jobs=jobs or 0, scheduler=scheduler, progress=progress)
    failed = [_failed(task, result, len(tasks) > 1) for task, result in results]
    return int(any(failed))


def _places(captures: Sequence[Path], map_dir: Path, maps_dir: Path | None) -> list[Path]:
    """Where the map of each capture goes; UsageError where two would go to the same."""
    if len(captures) > 1 and maps_dir is None:
        raise click.UsageError("expected --maps DIR, where each of several captures gets its map")
    names = [capture.resolve().name for capture in captures]
    for name in names:
        if names.count(name) > 1:
            raise click.UsageError(f"expected captures of different names, found two {name}")
    return [(maps_dir / name if maps_dir else map_dir).absolute() for name in names]


def _failed(task: "BuildTask", result: "BuiltMap | Failed", one_of_several: bool) -> bool:
    """Tell what became of a task; whether there is no map."""
    from vnav.core.report import Failed

    if isinstance(result, Failed):
        name = f"{task.name}: " if one_of_several else ""
        say(f"{result.traceback}vnav: {name}{result.reason}", err=True)
        return True
    show_map(task.map_dir, result)
    return False
