"""Complete a map by another capture."""

from pathlib import Path

import click

from vnav.cli.build_map import camera_option, capture_argument
from vnav.cli.options import config_options, console_progress
from vnav.cli.summary import show


@click.command()
@click.argument("map_dir", metavar="MAP", type=click.Path(path_type=Path))
@capture_argument
@config_options
@camera_option
@click.option("--force", is_flag=True, help="Go on although the depth units look wrong.")
def extend(
    map_dir: Path,
    capture_dir: Path,
    config_source: str | None,
    settings: tuple[str, ...],
    camera_file: Path | None,
    force: bool,
) -> None:
    """Add CAPTURE, another recording of the same place, to the finished map in the folder MAP.

    Keyframes of the capture are looked for in the map, as photos are; then both are optimised
    together. The map keeps its coordinates. It is made with the settings of the map, unless others
    are given, and takes the old one's place when it is finished: until then, and where the capture
    is refused, the old map is not touched. Interrupted, the same command goes on.

    Exit code 1: the capture cannot be used, or shows another place.

    \b
    vnav build-map ground-floor --map house
    vnav extend house kitchen
    vnav extend house bedroom --camera phone.toml
    """
    from vnav import api, config
    from vnav.io.sources.open_capture import open_capture
    from vnav.io.store.map_folder import MapFolder
    from vnav.pipeline.extend import made_with

    folder = MapFolder.open(map_dir)
    resolved = config.load(config_source, settings, made_with(folder))
    capture = open_capture(capture_dir, resolved.capture, camera_file)
    extended = api.extend_map(folder, capture, resolved, force=force, progress=console_progress())
    for warning in extended.warnings:
        click.echo(f"vnav: warning: {warning}", err=True)
    show(extended.reports)
    click.echo(f"map in {map_dir}, pictures in {map_dir / 'reports'}")
