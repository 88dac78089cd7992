"""Write parts of a map in the formats that other programs read."""

from pathlib import Path

import click

from vnav.cli.options import map_argument_or_option, warn
from vnav.cli.say import say
from vnav.io.store.export import PARTS, everything


@click.command()
@map_argument_or_option
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("."),
    show_default="the current folder",
    help="Folder to write to.",
)
@click.option(
    "--all", "all_parts", is_flag=True, help="Every part in every format that can be written."
)
def export(map_dir: Path, out: Path, all_parts: bool, **formats: tuple[str, ...]) -> None:
    """Write parts of a map in the formats asked for; several at once, also of one part.

    \b
    vnav export my-map --trajectory tum --cloud ply --out for-others
    vnav export --map my-map --octomap bt --octomap ot
    vnav export my-map --all --out for-others
    vnav export my-map --rerun rrd --out for-others
    """
    from vnav.api.map import open_map

    wanted = {part: list(forms) for part, forms in formats.items() if forms}
    if all_parts:
        wanted, reasons = everything()
        for reason in reasons:
            warn(f"left out: {reason}")
    if not wanted:
        names = ", ".join(f"--{part}" for part in PARTS)
        raise click.UsageError(f"expected at least one of {names}, or --all")
    for part, paths in open_map(map_dir).export(out, wanted).items():
        for path in paths:
            say(f"{part:12}{path} ({_size_mb(path):.2f} MB)")


def _size_mb(path: Path) -> float:
    """Of a file, or of the files of a folder."""
    files = path.iterdir() if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files) / 1e6


export.params += [
    click.Option(
        [f"--{name}"], type=click.Choice(list(part.formats)), multiple=True, help=part.meaning
    )
    for name, part in PARTS.items()
]
