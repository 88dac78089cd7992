"""The stages of a map as commands of their own; each reads what the ones before it wrote."""

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
    """Track every frame of a capture, or take given poses, and choose keyframes.

    The first stage of a map: 'vnav build-map' runs it and all that follow.

    \b
    vnav odometry my_capture --map my-map
    vnav odometry my_capture --map my-map --trajectory poses.tum
    """
    from vnav import config
    from vnav.api.building import track_capture

    report = track_capture(
        capture_dir,
        map_dir,
        config=config.load(config_source, settings),
        camera=camera_file,
        trajectory=trajectory_file,
        progress=console_progress(),
    )
    show([report])


def _stage_command(name: str, summary: str) -> click.Command:
    """A command that runs one stage on a map that exists."""
    example = f"vnav {name} --map my-map --set seed=1"

    @click.command(name, help=f"{summary}\n\n\b\n{example}")
    @map_option
    @config_options
    def command(map_dir: Path, config_source: str | None, settings: tuple[str, ...]) -> None:
        from vnav import config
        from vnav.api.building import run_stage

        resolved = config.load(config_source, settings)
        show([run_stage(name, map_dir, config=resolved, progress=console_progress())])

    return command


vocabulary = _stage_command("vocabulary", "Train the vocabulary tree on the keyframes' features.")
loops = _stage_command("loops", "Find and verify loops between keyframes.")
optimise = _stage_command("optimise", "Optimise poses and landmarks, and find the floor.")
fuse = _stage_command("fuse", "Fuse depth into cloud, octree, mesh and grid.")
index = _stage_command("index", "Index the landmarks, for locate.")
