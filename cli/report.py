"""Write everything about a map into one page."""

from pathlib import Path

import click


@click.command()
@click.argument("map_dir", metavar="MAP", type=click.Path(path_type=Path))
def report(map_dir: Path) -> None:
    """Write reports/report.html in the folder MAP: numbers, pictures, warnings, loops, lost spans.

    The page is one file that needs nothing else.
    """
    from vnav.api.map import open_map

    click.echo(open_map(map_dir).report())
