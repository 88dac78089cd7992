"""Plan a path from one place in a map to another."""

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from vnav.cli.locate import CAMERA_HELP
from vnav.cli.options import config_options, map_option, png_option, warn
from vnav.cli.say import say

if TYPE_CHECKING:
    from vnav.config import Config


@click.command()
@click.option(
    "--from",
    "start",
    required=True,
    metavar="current|X,Y|PHOTO|NAME",
    help="Where the path begins: the last located photo, or as for --to.",
)
@click.option(
    "--to",
    "goal",
    required=True,
    metavar="X,Y|PHOTO|NAME",
    help="Where it ends, and the robot looks: metres, a photo, or a goal of 'vnav edit'.",
)
@click.option(
    "--via",
    multiple=True,
    metavar="X,Y|PHOTO|NAME",
    help="Where it leads over; may be given several times, in order.",
)
@click.option(
    "--visit",
    multiple=True,
    metavar="X,Y|PHOTO|NAME",
    help="As --via, but in the order that is cheapest.",
)
@map_option
@config_options
@click.option("--camera", metavar="FILE|auto", help=CAMERA_HELP)
@click.option(
    "--robot-radius",
    "robot_radius_m",
    metavar="M",
    type=click.FloatRange(min=0),
    help="The robot's radius in metres; 0.2 by default.",
)
@click.option(
    "--footprint",
    metavar="'X,Y X,Y X,Y'",
    help="The robot's corners in metres, x forward, in place of its radius.",
)
@click.option(
    "--tolerance",
    "tolerance_m",
    metavar="M",
    type=click.FloatRange(min=0),
    help="How far start and goal may be moved to where the robot can be; 0.5 m by default.",
)
@click.option(
    "--no-walked",
    "allow_walked",
    flag_value=False,
    type=bool,
    default=None,
    help="Keep off unseen floor that the camera was carried over.",
)
@click.option(
    "--allow-unknown", is_flag=True, default=None, help="Cross space that was never seen."
)
@click.option("--json", "as_json", is_flag=True, help="Print the answer as one JSON object.")
@click.option("--csv", "csv_file", type=click.Path(path_type=Path), help="Write x,y,yaw too.")
@click.option(
    "--yaml",
    "yaml_file",
    type=click.Path(path_type=Path),
    help="Write a nav_msgs/Path for ROS 2 and Nav2 too.",
)
@png_option("Draw the path too, into a .png.")
def plan(
    start: str,
    goal: str,
    via: tuple[str, ...],
    visit: tuple[str, ...],
    map_dir: Path,
    config_source: str | None,
    settings: tuple[str, ...],
    camera: str | None,
    as_json: bool,
    csv_file: Path | None,
    yaml_file: Path | None,
    png_file: Path | None,
    **robot: Any,  # settings of section plan that have an option; None: not given
) -> int:
    """Plan a path that a robot can follow, from one place in a map to another.

    Exit code 0: found; 3: there is none, or a photo was not located, and the reason is given. The
    last path that was found is shown by 'vnav report'.

    \b
    vnav plan --from current --to goal.jpg --map my-map
    vnav plan --from here.jpg --to 2.5,-1 --csv path.csv --png path.png
    vnav plan --from current --to goal.jpg --yaml path.yaml
    vnav plan --from 0,0 --via kitchen --to desk
    vnav plan --from 0,0 --to desk --footprint '0.4,0.2 -0.3,0.2 -0.3,-0.2 0.4,-0.2'
    """
    from vnav import config
    from vnav.api.map import open_map
    from vnav.reporting.plan_text import summary, write_csv, write_ros_path

    if via and visit:
        raise click.UsageError("expected --via or --visit, found both")
    resolved = _for_robot(config.load(config_source, settings), robot)
    mapped = open_map(map_dir)
    asked: dict[str, Any] = {"camera": camera, "config": resolved, "remember": True}
    over = via or visit
    answer = mapped.plan(start, goal, via=over, any_order=bool(visit), **asked)
    for warning in dict.fromkeys(answer.warnings):
        warn(warning)
    for file, write in ((csv_file, write_csv), (yaml_file, write_ros_path)):
        if file and answer.found:
            write(file, answer.found)
    if png_file:
        mapped.draw_plan(answer, png_file)
    if as_json:
        click.echo(json.dumps(answer.as_dict(), indent=1, allow_nan=False))
    else:
        for line in summary(answer, start, goal, over):
            say(line)
    return 0 if answer.found else 3


def _for_robot(config: "Config", options: Mapping[str, Any]) -> "Config":
    """The settings with those of section plan that options give, None being none."""
    given = {name: value for name, value in options.items() if value is not None}
    if "robot_radius_m" in given:
        if given.get("footprint"):
            raise click.UsageError("expected --robot-radius or --footprint, found both")
        given["footprint"] = ""  # the settings may have one
    return dataclasses.replace(config, plan=dataclasses.replace(config.plan, **given))
