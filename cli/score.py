"""Measure a trajectory against the truth."""

import json
from pathlib import Path

import click

from vnav.cli.build_map import camera_option


@click.command()
@click.argument("trajectory", type=click.Path(path_type=Path))
@click.argument("truth", type=click.Path(path_type=Path))
@click.option(
    "--max-difference",
    "max_difference_s",
    metavar="S",
    type=click.FloatRange(min=0, min_open=True),
    default=0.02,
    show_default=True,
    help="Largest difference in time between a pose and its true one, in seconds.",
)
@click.option(
    "--frames",
    metavar="N",
    type=click.IntRange(1, 10**6),
    default=1,
    show_default=True,
    help="How many frames apart the poses are whose relative error is taken.",
)
@click.option(
    "--align",
    type=click.Choice(["se3", "sim3"]),
    default="se3",
    show_default=True,
    help="sim3 scales the poses to the true ones: for a trajectory without scale.",
)
@camera_option
@click.option("--json", "as_json", is_flag=True, help="Print the score as one JSON object.")
def score(
    trajectory: Path,
    truth: Path,
    max_difference_s: float,
    frames: int,
    align: str,
    camera_file: Path | None,
    as_json: bool,
) -> None:
    """Print ATE and RPE of the poses in TRAJECTORY against those in TRUTH.

    Both are TUM files, lines of 'stamp tx ty tz qx qy qz qw'. TRAJECTORY may also be a map's
    folder: its final poses, or odometry's where there are no others. TRUTH may also be a capture
    folder that comes with its truth. docs/scoring.md defines every figure.

    \b
    vnav score my-map my_capture
    vnav score my-map/optimise/trajectory_0.tum my_capture
    vnav score my-odometry my_capture --align sim3 --json
    """
    from vnav.api.judging import score as measure
    from vnav.evaluation.score import table

    result = measure(
        trajectory,
        truth,
        max_difference_s=max_difference_s,
        frames=frames,
        align=align,
        camera=camera_file,
    )
    if as_json:
        click.echo(json.dumps(result.as_dict(), indent=1, allow_nan=False))
        return
    for line in table(result):
        click.echo(line)
