"""Show what each tracker finds of one frame in another."""

import json
from pathlib import Path

import click

from vnav.cli.build_map import camera_option, capture_argument
from vnav.cli.options import config_options, png_option
from vnav.cli.say import say


@click.command()
@capture_argument
@click.argument("a", type=int)
@click.argument("b", type=int)
@config_options
@camera_option
@png_option("Draw the matches too, into a .png: green right, red wrong.")
@click.option("--json", "as_json", is_flag=True, help="Print the table as one JSON array.")
def tracks(
    capture_dir: Path,
    a: int,
    b: int,
    config_source: str | None,
    settings: tuple[str, ...],
    camera_file: Path | None,
    png_file: Path | None,
    as_json: bool,
) -> None:
    """Find the points of frame A of the folder CAPTURE in its frame B, by every tracker.

    Frames are counted from 0. Where the capture has depth and comes with its truth, a match is
    right within 3 px of where the truth puts its point: precision is the share of right matches,
    recall that of the points that frame B sees.

    \b
    vnav tracks my_capture 10 12
    vnav tracks my_capture 10 12 --png found.png
    """
    from vnav import config
    from vnav.api.judging import compare_trackers
    from vnav.evaluation.tracker_matches import table
    from vnav.reporting.tracks_picture import draw

    resolved = config.load(config_source, settings)
    pair = compare_trackers(capture_dir, a, b, config=resolved, camera=camera_file)
    if png_file is not None:
        draw(pair, png_file)
    if as_json:
        click.echo(json.dumps([matches.as_dict() for matches in pair.matches], indent=1))
        return
    for line in table(pair.matches):
        say(line)
