"""Write parts of a map in the formats that other programs read."""

from pathlib import Path

import click

from vnav.cli.options import map_argument_or_option
from vnav.cli.say import say
from vnav.io.store.export import PARTS


@click.command()
@map_argument_or_option
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("."),
    show_default="the current folder",
    help="Folder to write to.",
)
def export(map_dir: Path, out: Path, **formats: tuple[str, ...]) -> None:
    """Write parts of a map in the formats asked for; several at once, also of one part.

    \b
    vnav export my-map --trajectory tum --cloud ply --out for-others
    vnav export --map my-map --octomap bt --octomap ot
    """
    from vnav.api.map import open_map

    wanted = {part: forms for part, forms in formats.items() if forms}
    if not wanted:
        names = ", ".join(f"--{part}" for part in PARTS)
        raise click.UsageError(f"expected at least one of {names}")
    for part, paths in open_map(map_dir).export(out, wanted).items():
        for path in paths:
            say(f"{part:12}{path} ({path.stat().st_size / 1e6:.2f} MB)")


export.params += [
    click.Option(
        [f"--{name}"], type=click.Choice(list(part.formats)), multiple=True, help=part.meaning
    )
    for name, part in PARTS.items()
]
