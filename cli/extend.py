"""Complete a map by another capture."""

from pathlib import Path

import click

from vnav.cli.build_map import camera_option, capture_argument
from vnav.cli.options import config_options, console_progress
from vnav.cli.summary import show_map


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
    from vnav import config
    from vnav.api.building import extend_map
    from vnav.api.map import open_map

    base = open_map(map_dir).config()
    extended = extend_map(
        map_dir,
        capture_dir,
        config=config.load(config_source, settings, base),
        camera=camera_file,
        force=force,
        progress=console_progress(),
    )
    assert extended.built is not None
    show_map(map_dir, extended.built)
