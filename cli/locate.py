"""Find where photos were taken."""

import json
import os
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import click

from vnav.cli.logs import is_quiet
from vnav.cli.options import (
    batch_options,
    config_options,
    console_progress,
    loaded,
    map_option,
    require_one_way,
    warn,
)
from vnav.cli.say import say
from vnav.core.progress import Progress, silent

if TYPE_CHECKING:
    from vnav.api.map import Map
    from vnav.localisation.verdict.answer import PhotoAnswer, UnreadablePhoto

    Answer: TypeAlias = PhotoAnswer | UnreadablePhoto

CAMERA_HELP = (
    "Camera of the photos: a camera.toml, a tool's file, or 'auto' to estimate it. Else camera.toml"
    " beside the photo, its EXIF, the map's camera if the size is the same, else auto."
)


@click.command()
@click.argument("photos", nargs=-1, type=click.Path(path_type=Path))
@click.option("--stdin", "from_stdin", is_flag=True, help="Answer paths from stdin, one a line.")
@click.option(
    "--watch",
    "watched",
    metavar="DIR",
    type=click.Path(path_type=Path),
    help="Answer the photos of a folder, and each one that comes.",
)
@click.option(
    "--sequence", is_flag=True, help="The photos were taken one after the other: see below."
)
@map_option
@config_options
@click.option("--camera", metavar="FILE|auto", help=CAMERA_HELP)
@click.option("--json", "as_json", is_flag=True, help="Print JSON: an object, or an array.")
@click.option("--csv", "csv_file", type=click.Path(path_type=Path), help="Write a table too.")
@click.option(
    "--overlay",
    type=click.Path(path_type=Path),
    help="Draw the inliers into this file; for several photos a folder.",
)
@batch_options
def locate(
    photos: tuple[Path, ...],
    from_stdin: bool,
    watched: Path | None,
    sequence: bool,
    map_dir: Path,
    config_source: str | None,
    settings: tuple[str, ...],
    camera: str | None,
    as_json: bool,
    csv_file: Path | None,
    overlay: Path | None,
    jobs: int | None,
    scheduler: str,
) -> int:
    """Find where PHOTOS, or the photos in folders, were taken.

    Exit code 0: located, all of them; 3: not located, the reason is given; 1: an error, or a photo
    that cannot be read. The pose of a single located photo becomes the map's current place, where
    'vnav plan --from current' starts. Several photos keep all cores busy; --jobs and --scheduler
    share out very many.

    With --stdin or --watch the map stays loaded, and each answer is one line of JSON, flushed at
    once. A photo that is still being written is waited for. The current place stays as it is.
    --stdin has one answer a line, an error too; --watch goes on until Ctrl-C.

    With --sequence, a pose near that of the photo before needs less evidence of its own. A pose
    that is not given without it is said to be so: "held by the photos before".

    \b
    vnav locate photo.jpg --map my-map
    vnav locate photo.jpg --camera camera.toml --json
    vnav locate photos/ --csv poses.csv --overlay drawn/
    vnav locate thousands/ --json --scheduler tcp://10.0.0.1:8786
    ls photos/*.jpg | vnav locate --stdin --map my-map
    vnav locate --watch incoming/ --map my-map
    """
    from vnav import config
    from vnav.api.map import open_map
    from vnav.io.photos.photo_files import find_photos

    streams = from_stdin or watched is not None
    share: dict[str, Any] = {"jobs": jobs or 0, "scheduler": scheduler}
    require_one_way(jobs, scheduler)
    _require_one_source(photos, from_stdin, watched)
    _require_no(streams, {"overlay": overlay}, "--stdin or --watch")
    _require_no(streams or sequence, share, "--stdin, --watch or --sequence")
    mapped, resolved = open_map(map_dir), config.load(config_source, settings)
    paths, alone = find_photos(photos), _is_one(photos)
    _require_another(csv_file, paths)
    pictures = _pictures(paths, overlay, alone)
    shown = _Shown("lines" if streams else _form(as_json, alone), alone)
    asked: dict[str, Any] = {"camera": camera, "config": resolved}
    answers: Iterable[Answer]
    if alone:
        answers = [mapped.locate(paths[0], remember=True, **asked)]
    elif streams or sequence:
        source = _arriving(watched) if streams else paths
        answers = mapped.locate_each(source, sequence=sequence, **asked)
    else:
        answers = mapped.locate_all(paths, remember=True, progress=shown.progress, **asked, **share)
    return _tell(mapped, answers, shown, csv_file, pictures)


def _tell(
    mapped: "Map",
    answers: "Iterable[Answer]",
    shown: "_Shown",
    csv_file: Path | None,
    pictures: dict[Path, Path],
) -> int:
    """Tell each answer as it is found, its row in the table first; the exit code."""
    from vnav.reporting.photo_table import photo_table

    with shown, photo_table(csv_file) as add_row:
        for answer in answers:
            add_row(answer)
            shown.add(answer)
            _draw(mapped, answer, pictures)
    return shown.exit_code


class _Shown:
    """Answers on stdout as they are found, what is doubtful about them and their number on stderr.

    ``form``: "text", "object", "array" (at the end) or "lines".
    """

    def __init__(self, form: str, alone: bool) -> None:
        self._form, self._alone = form, alone
        self._array = list[dict[str, Any]]()
        self._warned = set[str]()
        self._answered, self._read, self._located = 0, 0, 0

    @property
    def progress(self) -> Progress:
        """Shown where answers are not: they would stand in its line."""
        return silent if self._form == "text" and sys.stdout.isatty() else console_progress()

    @property
    def exit_code(self) -> int:
        """1 where a photo could not be read, 3 where one was not located."""
        if self._read < self._answered:
            return 1
        return 0 if self._located == self._answered else 3

    def add(self, answer: "Answer") -> None:
        """Print an answer, and warnings that are new."""
        from vnav.localisation.verdict.answer import PhotoAnswer, summary

        self._answered += 1
        self._located += answer.located
        if self._form == "text":
            say(summary(answer))
        elif self._form == "array":
            self._array.append(answer.as_dict())
        else:
            _print_json(answer.as_dict(), as_line=self._form == "lines")
        if isinstance(answer, PhotoAnswer):
            self._read += 1
            self._warn(answer.warnings)

    def _warn(self, warnings: Iterable[str]) -> None:
        """Say what was not said of another photo."""
        new = set(warnings) - self._warned
        for warning in sorted(new):
            warn(warning)
        self._warned |= new

    def __enter__(self) -> None:
        if not self._alone:
            loaded()

    def __exit__(self, kind: type[BaseException] | None, *_error: object) -> None:
        if self._form == "array" and kind is None:
            _print_json(self._array)
        if self._answered and not self._alone and not is_quiet():
            say(f"{self._located} of {self._answered} located", err=True)


def _form(as_json: bool, alone: bool) -> str:
    """How answers are printed."""
    if not as_json:
        return "text"
    return "object" if alone else "array"


def _print_json(values: object, *, as_line: bool = False) -> None:
    layout: dict[str, Any] = {"separators": (",", ":")} if as_line else {"indent": 1}
    click.echo(json.dumps(values, allow_nan=False, **layout))


def _require_one_source(photos: Sequence[Path], from_stdin: bool, watched: Path | None) -> None:
    """UsageError unless photos are named in one way."""
    given = {"PHOTOS": photos, "--stdin": from_stdin, "--watch": watched is not None}
    named = [name for name, value in given.items() if value]
    if len(named) != 1:
        found = " and ".join(named) or "none of them"
        raise click.UsageError(f"expected PHOTOS, --stdin or --watch DIR, found {found}")


def _require_no(where: object, options: Mapping[str, object], beside: str) -> None:
    """UsageError where one of the options is given where it has no place."""
    for name, value in options.items():
        if where and value:
            raise click.UsageError(f"expected --{name} with PHOTOS alone, found it with {beside}")


def _require_another(table: Path | None, photos: Sequence[Path]) -> None:
    """UsageError where a photo would be written over by the table."""
    if table and table.resolve() in {photo.resolve() for photo in photos}:
        raise click.UsageError(f"expected another file for --csv than a photo, found {table}")


def _arriving(watched: Path | None) -> Iterator[Path]:
    """The photos of a folder as they come, else the paths on stdin, one a line."""
    from vnav.io.photos.arriving import arriving_photos

    if watched is not None:
        yield from arriving_photos(watched)
    else:
        for line in sys.stdin.buffer:
            yield Path(os.fsdecode(line.rstrip(b"\r\n")))


def _is_one(photos: Sequence[Path]) -> bool:
    """Whether a single photo is asked for, not a folder of one."""
    return len(photos) == 1 and not photos[0].is_dir()


def _pictures(photos: Sequence[Path], overlay: Path | None, alone: bool) -> dict[Path, Path]:
    """Which file each photo is drawn into, no photo among them; UsageError where that cannot be."""
    if overlay is None:
        return {}
    if alone and not overlay.is_dir():
        return {photos[0]: overlay}
    if overlay.is_file() or overlay.suffix.lower() in (".jpg", ".jpeg", ".png"):
        raise click.UsageError(f"expected a folder with --overlay for several photos: {overlay}")
    names, taken = {photo.resolve() for photo in photos}, dict[Path, Path]()
    for photo in photos:
        number, path = 1, overlay / f"{photo.stem}.jpg"
        while path.resolve() in names:
            number += 1
            path = overlay / f"{photo.stem}-{number}.jpg"
        names.add(path.resolve())
        taken[photo] = path
    return taken


def _draw(mapped: "Map", answer: "Answer", pictures: dict[Path, Path]) -> None:
    """A picture of a photo that could be read."""
    from vnav.localisation.verdict.answer import PhotoAnswer

    if isinstance(answer, PhotoAnswer) and answer.path in pictures:
        mapped.draw_photo(answer, pictures[answer.path])
