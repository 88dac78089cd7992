"""Write everything about a map into one page."""

from pathlib import Path

import click

from vnav.cli.options import map_argument_or_option
from vnav.cli.say import say


@click.command()
@map_argument_or_option
def report(map_dir: Path) -> None:
    """Write reports/report.html in a map: verdict, 3D view, pictures, loops, lost spans.

    The page is one file that needs nothing else. Photos that were located last and the last path
    are part of it.

    \b
    vnav report my-map
    """
    from vnav.api.map import open_map

    say(open_map(map_dir).report())
