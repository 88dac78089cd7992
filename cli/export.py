"""Write parts of a map in the formats that other programs read."""

from pathlib import Path

import click


@click.command()
@click.argument("map_dir", metavar="MAP", type=click.Path(path_type=Path))
@click.option("--trajectory", type=click.Choice(["tum", "kitti"]), help="Poses of all frames.")
@click.option("--cloud", type=click.Choice(["ply"]), help="The coloured cloud.")
@click.option("--octomap", type=click.Choice(["bt", "ot"]), help="Occupied and free space.")
@click.option("--grid", type=click.Choice(["pgm"]), help="The grid, as ROS map_server reads it.")
@click.option("--mesh", type=click.Choice(["ply", "obj"]), help="The coloured surface.")
@click.option("--graph", type=click.Choice(["g2o"]), help="The pose graph.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("."),
    show_default="the current folder",
    help="Folder to write to.",
)
def export(map_dir: Path, out: Path, **formats: str | None) -> None:
    """Write parts of the map in the folder MAP, in the formats asked for; several at once."""
    from vnav.api.map import open_map

    wanted = {kind: form for kind, form in formats.items() if form is not None}
    if not wanted:
        names = ", ".join(f"--{kind}" for kind in formats)
        raise click.UsageError(f"expected at least one of {names}")
    for kind, paths in open_map(map_dir).export(out, wanted).items():
        for path in paths:
            click.echo(f"{kind:12}{path} ({path.stat().st_size / 1e6:.2f} MB)")
