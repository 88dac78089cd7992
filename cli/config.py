"""Tell what can be set, what a preset changes, and what a map was made with."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from vnav.io.store.recorded_settings import RecordedSettings


@click.command()
@click.argument("source", metavar="[PRESET|FILE|MAP]", required=False)
@click.option("--json", "as_json", is_flag=True, help="Print JSON: an array of all, or an object.")
@click.option("--markdown", is_flag=True, help="Print all settings as docs/settings.md has them.")
def config(source: str | None, as_json: bool, markdown: bool) -> None:
    """List all settings, or what a PRESET or FILE changes, or what a MAP was made with.

    A name is taken as --config takes it: a file, else the preset. Any other folder is a map; write
    ./fast for the map in a folder that is called as a preset.

    \b
    vnav config                        every setting: default, range, unit, meaning
    vnav config fast                   what the preset changes
    vnav config my-map                 what the map was made with
    vnav config my-map --json
    vnav build-map my_capture --config fast --set fuse.voxel_m=0.05
    """
    from vnav.config import listing, load, presets
    from vnav.errors import ConfigError

    if source and markdown:
        raise click.UsageError("expected --markdown alone, found a source with it")
    if source is None:
        _list(as_json, markdown)
    elif Path(source).is_file() or source in presets():
        _tell_changes(source, listing.changes(load(source)), as_json)
    elif Path(source).is_dir():
        _tell_map(Path(source), as_json)
    else:
        known = ", ".join(presets())
        raise ConfigError(
            f"expected a preset ({known}), a TOML file or the folder of a map, found none of them:"
            f" '{source}'"
        )


def _list(as_json: bool, markdown: bool) -> None:
    from vnav.config import listing

    if as_json:
        click.echo(json.dumps(listing.rows(), indent=1))
    elif markdown:
        click.echo(listing.markdown(), nl=False)
    else:
        for line in listing.lines():
            click.echo(line)


def _tell_changes(source: str, changes: dict[str, Any], as_json: bool) -> None:
    if as_json:
        click.echo(json.dumps({"source": source, "changes": changes}, indent=1))
        return
    for line in _values(changes):
        click.echo(line)


def _tell_map(root: Path, as_json: bool) -> None:
    from vnav.io.store.map_folder import MapFolder
    from vnav.io.store.recorded_settings import recorded_settings

    found = recorded_settings(MapFolder.open(root))
    if as_json:
        values = {"map": str(root), "settings": found.agreed, "disagree": found.disagreed}
        click.echo(json.dumps(values | {"missing": found.missing}, indent=1))
        return
    for line in (*_values(found.agreed), *_warnings(found)):
        click.echo(line)


def _values(values: dict[str, Any]) -> Iterator[str]:
    """A line for each setting, with its default where it has another value."""
    from vnav.config import SETTINGS
    from vnav.config.setting import plain

    width = max((len(name) for name in values), default=0)
    for name, value in values.items():
        default = SETTINGS[name].default
        note = f"default {plain(default)}" if value != default else ""
        yield f"{name:{width}}  {plain(value):10}  {note}".rstrip()


def _warnings(found: "RecordedSettings") -> Iterator[str]:
    """What cannot be told of a map, or not as one value."""
    from vnav.config.setting import plain

    for name, by_stage in found.disagreed.items():
        told = ", ".join(f"{plain(value)} in {stage}" for stage, value in by_stage.items())
        yield f"stages disagree: {name} is {told}"
    if found.missing:
        yield f"stages missing: {', '.join(found.missing)}"
