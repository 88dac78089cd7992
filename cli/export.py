"""Write parts of a map in the formats that other programs read."""

from pathlib import Path

import click

from vnav.io.store.export import PARTS


@click.command()
@click.argument("map_dir", metavar="MAP", type=click.Path(path_type=Path))
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("."),
    show_default="the current folder",
    help="Folder to write to.",
)
def export(map_dir: Path, out: Path, **formats: str | None) -> None:
    """Write parts of the map in the folder MAP, in the formats asked for; several at once.

    \b
    vnav export my-map --trajectory tum --cloud ply --out for-others
    """
    from vnav.api.map import open_map

    wanted = {part: form for part, form in formats.items() if form is not None}
    if not wanted:
        names = ", ".join(f"--{part}" for part in PARTS)
        raise click.UsageError(f"expected at least one of {names}")
    for part, paths in open_map(map_dir).export(out, wanted).items():
        for path in paths:
            click.echo(f"{part:12}{path} ({path.stat().st_size / 1e6:.2f} MB)")


export.params += [
    click.Option([f"--{name}"], type=click.Choice(list(part.formats)), help=part.meaning)
    for name, part in PARTS.items()
]
