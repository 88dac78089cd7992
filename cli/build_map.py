"""Make a map from a capture."""

from pathlib import Path

import click

from vnav.cli.options import config_options, console_progress, map_option
from vnav.cli.summary import show

capture_argument = click.argument("capture_dir", metavar="CAPTURE", type=click.Path(path_type=Path))
camera_option = click.option(
    "--camera",
    "camera_file",
    type=click.Path(path_type=Path),
    help="Camera of the capture, where it has no camera.toml.",
)


@click.command("build-map")
@capture_argument
@map_option
@config_options
@camera_option
@click.option("--fresh", is_flag=True, help="Delete the map that is there and start anew.")
@click.option("--force", is_flag=True, help="Go on although the depth units look wrong.")
def build_map(
    capture_dir: Path,
    map_dir: Path,
    config_source: str | None,
    settings: tuple[str, ...],
    camera_file: Path | None,
    fresh: bool,
    force: bool,
) -> None:
    """Make a map of the RGB-D frames in the folder CAPTURE.

    Stages that are up to date are kept, so that an interrupted run goes on where it stopped.
    """
    from vnav import config
    from vnav.io.capture import open_capture
    from vnav.io.map_folder import MapFolder
    from vnav.stages import build_map as chain
    from vnav.stages.check import require_usable

    resolved, progress = config.load(config_source, settings), console_progress()
    capture = open_capture(capture_dir, resolved.capture, camera_file)
    checked = require_usable(capture, force=force, progress=progress)
    for warning in checked.warnings:
        click.echo(f"vnav: warning: {warning}", err=True)
    folder = MapFolder.create(map_dir, fresh)
    show(chain.build_map(folder, [capture], resolved, progress=progress))
    click.echo(f"map in {map_dir}, pictures in {map_dir / 'reports'}")
