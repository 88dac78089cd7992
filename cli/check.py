"""Tell whether a capture is fit to be mapped."""

import json
from pathlib import Path

import click

from vnav.cli.build_map import camera_option, capture_argument
from vnav.cli.options import config_options, console_progress, png_option
from vnav.cli.say import say


@click.command()
@capture_argument
@config_options
@camera_option
@png_option("Draw six frames into a .png: colour, and over it the edges of depth.")
@click.option("--json", "as_json", is_flag=True, help="Print the report as one JSON object.")
def check(
    capture_dir: Path,
    config_source: str | None,
    settings: tuple[str, ...],
    camera_file: Path | None,
    png_file: Path | None,
    as_json: bool,
) -> int:
    """Look at the RGB-D frames in the folder CAPTURE before a map is made of them.

    Every file is read, some frames are measured. Exit code 1 where something would stop a map.
    Depth that lies beside colour makes a bad map in silence: --png shows it.

    \b
    vnav check my_capture --png edges.png
    vnav check my_capture --camera camera.toml --json
    """
    from vnav import config
    from vnav.api.judging import check as look
    from vnav.checking.capture_report import problems as problems_of
    from vnav.checking.capture_report import summary

    resolved = config.load(config_source, settings)
    progress = console_progress()
    report = look(
        capture_dir, config=resolved, camera=camera_file, picture=png_file, progress=progress
    )
    problems = problems_of(report)
    if as_json:
        click.echo(json.dumps(report.as_dict() | {"problems": problems}, indent=1))
        return int(bool(problems))
    for line in summary(report):
        say(line)
    for warning in report.warnings:
        say(f"warning  {warning}")
    for problem in problems:
        say(f"FATAL    {problem}")
    if not problems:
        warned = ", but for what is warned of" if report.warnings else ""
        click.echo(f"fit to be mapped{warned}")
    return int(bool(problems))
