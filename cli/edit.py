"""Give places of a map names: goals, floor to keep out of, floor to cross one way only."""

import math
from pathlib import Path
from typing import TYPE_CHECKING

import click

from vnav.cli.locate import CAMERA_HELP
from vnav.cli.say import say

if TYPE_CHECKING:
    from vnav.core.places import LostPlace, NamedPlace

NEGATIVE = {"ignore_unknown_options": True}  # -1,2 is a point


@click.group()
@click.argument("map_dir", metavar="MAP", type=click.Path(path_type=Path))
@click.pass_context
def edit(context: click.Context, map_dir: Path) -> None:
    """Name places of MAP, which 'vnav plan' goes to, keeps out of, or crosses one way only.

    They are kept in MAP/places.toml, each tied to the nearest keyframe: a map that is built again
    or extended moves them with it.

    \b
    vnav edit my-map add-goal desk 2.5,-1
    vnav edit my-map add-goal kitchen kitchen.jpg
    vnav edit my-map keep-out stairs 1,1 2,1 2,3 1,3
    vnav edit my-map one-way aisle 4,0 5,0 5,3 4,3 --heading 90
    vnav edit my-map list
    vnav edit my-map remove stairs
    """
    context.obj = map_dir


@edit.command(context_settings=NEGATIVE)
@click.argument("name")
@click.argument("place", metavar="X,Y|PHOTO")
@click.option("--camera", metavar="FILE|auto", help=CAMERA_HELP)
@click.pass_obj
def add_goal(map_dir: Path, name: str, place: str, camera: str | None) -> None:
    """Name a goal.

    It is given in metres in the map's world, or is where a photo was taken, and looks as that does.

    \b
    vnav edit my-map add-goal desk 2.5,-1
    vnav edit my-map add-goal kitchen kitchen.jpg --camera camera.toml
    """
    from vnav.api.map import open_map
    from vnav.core.places import point_of

    mapped = open_map(map_dir)
    mapped.add_goal(name, point_of(place) or place, camera=camera)
    say(_line(name, mapped.places()[name]))


@edit.command(context_settings=NEGATIVE)
@click.argument("name")
@click.argument("corners", nargs=-1, required=True, metavar="X,Y...")
@click.pass_obj
def keep_out(map_dir: Path, name: str, corners: tuple[str, ...]) -> None:
    """Name floor that no path enters.

    It is a polygon of three corners or more, in metres in the map's world.

    \b
    vnav edit my-map keep-out stairs 1,1 2,1 2,3 1,3
    """
    from vnav.api.map import open_map

    points = _points(corners)
    mapped = open_map(map_dir)
    mapped.keep_out(name, points)
    say(_line(name, mapped.places()[name]))


@edit.command(context_settings=NEGATIVE)
@click.argument("name")
@click.argument("corners", nargs=-1, required=True, metavar="X,Y...")
@click.option(
    "--heading",
    "heading_deg",
    metavar="DEG",
    required=True,
    type=click.FloatRange(-360, 360),
    help="The way it leads, in degrees from x towards y: 0 is along x, 90 along y.",
)
@click.pass_obj
def one_way(map_dir: Path, name: str, corners: tuple[str, ...], heading_deg: float) -> None:
    """Name floor that paths cross one way only.

    It is a polygon of three corners or more, in metres in the map's world. Inside it a path moves
    at most 90 degrees off the heading: ahead or to the side, never back.

    \b
    vnav edit my-map one-way aisle 4,0 5,0 5,3 4,3 --heading 90
    """
    from vnav.api.map import open_map

    points = _points(corners)
    mapped = open_map(map_dir)
    mapped.one_way(name, points, math.radians(heading_deg))
    say(_line(name, mapped.places()[name]))


@edit.command("list")
@click.pass_obj
def list_places(map_dir: Path) -> None:
    """Tell where all places are in the map now.

    \b
    vnav edit my-map list
    """
    from vnav.api.map import open_map

    places = open_map(map_dir).places()
    if not places:
        say("no places yet", err=True)
    for name, place in places.items():
        say(_line(name, place))


@edit.command()
@click.argument("name")
@click.pass_obj
def remove(map_dir: Path, name: str) -> None:
    """Forget a place.

    \b
    vnav edit my-map remove stairs
    """
    from vnav.api.map import open_map

    open_map(map_dir).remove_place(name)


def _points(corners: tuple[str, ...]) -> list[tuple[float, float]]:
    """The corners of a polygon; UsageError where one is no point."""
    from vnav.core.places import point_of

    points = [point_of(corner) for corner in corners]
    if None in points:
        wrong = corners[points.index(None)]
        raise click.UsageError(f"expected corners X,Y in metres, found {wrong!r}")
    return [point for point in points if point]


def _line(name: str, place: "NamedPlace | LostPlace") -> str:
    """What is told of a place."""
    from vnav.core.places import ONE_WAY, NamedPlace

    if not isinstance(place, NamedPlace):
        return f"{name:20}{place.kind:10}lies nowhere: {place.reason}"
    where = "  ".join(f"({x:.2f}, {y:.2f})" for x, y in place.points_m.round(2) + 0.0)
    verb = "leads" if place.kind == ONE_WAY else "looks"
    looks = "" if place.yaw_rad is None else f", {verb} {math.degrees(place.yaw_rad):.0f} deg"
    return f"{name:20}{place.kind:10}{where}{looks}"
