"""The stages of a map as commands of their own; each reads what the ones before it wrote."""

from importlib import import_module
from pathlib import Path

import click

from vnav.cli.build_map import camera_option, capture_argument, trajectory_option
from vnav.cli.options import config_options, console_progress, map_option
from vnav.cli.summary import show


@click.command()
@capture_argument
@map_option
@config_options
@camera_option
@trajectory_option
def odometry(
    capture_dir: Path,
    map_dir: Path,
    config_source: str | None,
    settings: tuple[str, ...],
    camera_file: Path | None,
    trajectory_file: Path | None,
) -> None:
    """Track every frame of a capture, or take given poses, and choose keyframes."""
    from vnav import config
    from vnav.io.formats.trajectories import read_tum
    from vnav.io.sources.open_capture import open_capture
    from vnav.io.store.map_folder import MapFolder
    from vnav.pipeline.build import expect_capture
    from vnav.stages import odometry as stage

    resolved = config.load(config_source, settings)
    capture = open_capture(capture_dir, resolved.capture, camera_file)
    given = read_tum(trajectory_file) if trajectory_file else None
    folder = MapFolder.create(map_dir)
    expect_capture(folder, capture)
    show([stage.run(folder, capture, resolved, given=given, progress=console_progress())])


def _stage_command(name: str, summary: str) -> click.Command:
    """A command that runs one stage on a map that exists."""

    @click.command(name, help=summary)
    @map_option
    @config_options
    def command(map_dir: Path, config_source: str | None, settings: tuple[str, ...]) -> None:
        from vnav import api, config
        from vnav.io.store.map_folder import MapFolder

        resolved = config.load(config_source, settings)
        MapFolder.open(map_dir)
        run = api.fuse if name == "fuse" else import_module(f"vnav.stages.{name}").run
        show([run(MapFolder.create(map_dir), resolved, progress=console_progress())])

    return command


vocabulary = _stage_command("vocabulary", "Train the vocabulary tree on the keyframes' features.")
loops = _stage_command("loops", "Find and verify loops between keyframes.")
optimise = _stage_command("optimise", "Optimise poses and landmarks, and find the floor.")
fuse = _stage_command("fuse", "Fuse depth into cloud, octree, mesh and grid.")
index = _stage_command("index", "Index the landmarks, for locate.")
