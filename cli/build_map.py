"""Make maps of captures."""

from pathlib import Path

import click

from vnav.cli.options import (
    batch_options,
    config_options,
    console_progress,
    map_option,
    require_one_way,
)
from vnav.cli.summary import show_map

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
    from vnav.core.report import Failed

    require_one_way(jobs, scheduler)
    if len(captures) > 1 and maps_dir is None:
        raise click.UsageError("expected --maps DIR, where each of several captures gets its map")
    if len(captures) > 1 and trajectory_file is not None:
        raise click.UsageError("expected one CAPTURE with --trajectory, found several")
    resolved, camera = config.load(config_source, settings), camera_file and camera_file.absolute()
    given = trajectory_file and trajectory_file.absolute()
    tasks: list[BuildTask] = []
    for capture in captures:
        folder = maps_dir / capture.resolve().name if maps_dir else map_dir
        place = folder.absolute()
        task = BuildTask(capture.absolute(), place, resolved, camera, given, fresh, force)
        if place in (other.map_dir for other in tasks):
            raise click.UsageError(f"expected captures of different names, found two {task.name}")
        tasks.append(task)

    failed = False
    progress = console_progress()
    for task, result in build_maps(tasks, jobs=jobs or 0, scheduler=scheduler, progress=progress):
        if isinstance(result, Failed):
            failed = True
            name = f"{task.name}: " if len(tasks) > 1 else ""
            click.echo(f"{result.traceback}vnav: {name}{result.reason}", err=True)
        else:
            show_map(task.map_dir, result)
    return int(failed)
