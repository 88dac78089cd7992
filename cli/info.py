"""Tell what a map holds."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from vnav.cli.options import map_argument_or_option
from vnav.cli.say import say


@click.command()
@map_argument_or_option
@click.option("--json", "as_json", is_flag=True, help="Print everything as one JSON object.")
def info(map_dir: Path, as_json: bool) -> None:
    """Print what a map holds, and which of its stages are up to date.

    \b
    vnav info my-map
    vnav info --map my-map --json
    """
    from vnav.api.map import open_map

    values = open_map(map_dir).info()
    if as_json:
        click.echo(json.dumps(values, indent=1))
        return
    for title, line in _lines(values):
        say(f"{title:12}{line}")


def _lines(values: dict[str, Any]) -> Iterator[tuple[str, str]]:
    yield from _head(values)
    yield from _frames(values)
    if "loops" in values:
        loops = values["loops"]
        near = f"{loops['neighbours_accepted']} of {loops['neighbours_tried']} pairs of neighbours"
        yield "loops", f"{loops['accepted']} of {loops['tried']} candidates accepted, and {near}"
    if "landmarks" in values:
        yield "path", f"{values['path_m']:.1f} m"
        yield "landmarks", str(values["landmarks"])
        yield "world", _world(values["world"])
    if "grid" in values:
        yield "grid", _grid(values["grid"])
    yield from _located(values["current"])
    for name, stage in values["stages"].items():
        seconds = "" if stage["seconds"] is None else f"{stage['seconds']:8.1f} s"
        yield "stage", f"{name:12}{stage['state']:9}{stage['size_mb']:8.1f} MB{seconds}"


def _located(current: dict[str, Any] | None) -> Iterator[tuple[str, str]]:
    from vnav.io.store.records import located_camera

    located = located_camera(current)
    if current is not None and located is not None:
        x, y, z = located[0][:3, 3]
        yield "located", f"{current['photo']}: at {x:.3f} {y:.3f} {z:.3f} m"


def _frames(values: dict[str, Any]) -> Iterator[tuple[str, str]]:
    from vnav.core.mapping import Span, in_short, light_texts

    if "frames" in values:
        frames = f"{values['tracked']} of {values['frames']} tracked"
        yield "frames", f"{frames}, {values['keyframes']} keyframes"
    for span in in_short([Span(**lost) for lost in values.get("lost", [])]):
        where = f"{span.first} to {span.last} of capture {span.capture}"
        yield "no pose", f"frames {where}: {span.reason}"
    for light in values.get("light", []):
        for text in light_texts(light["corners"], light["bands"]):
            yield "light", f"capture {light['capture']}: {text}"


def _head(values: dict[str, Any]) -> Iterator[tuple[str, str]]:
    yield "map", f"{values['map']}, {values['size_mb']:.1f} MB"
    if values["quality"]:
        yield "quality", "; ".join([values["quality"]["verdict"], *values["quality"]["doubts"]])
    for capture in values["captures"]:
        width, height = capture["size_px"]
        yield "capture", f"{capture['id']}: {capture['name']}, {width} x {height}"


def _world(world: dict[str, Any]) -> str:
    from vnav.core.mapping import how_held

    held = how_held(world["up_in_images"])
    return f"{_found_world(world)}; {held}" if held else _found_world(world)


def _found_world(world: dict[str, Any]) -> str:
    if world["source"] == "floor":
        return f"z up from the floor, flat within {world['floor_rms_m'] * 1000:.0f} mm"
    if world["source"] == "given":
        return "z up as given with the poses"
    if world["source"] == "kept":
        return "that of the map before it was extended"
    return f"no floor was seen: z up from the {world['source']}"


def _grid(grid: dict[str, Any]) -> str:
    width, height = grid["size_m"]
    areas = ", ".join(f"{area:.1f} m2 {state}" for state, area in grid["area_m2"].items())
    return f"{width:.1f} x {height:.1f} m: {areas}"
