"""Find where photos were taken."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import click

from vnav.cli.options import (
    batch_options,
    config_options,
    console_progress,
    map_option,
    require_one_way,
    warn,
)
from vnav.cli.say import say

if TYPE_CHECKING:
    from vnav.api.map import Map
    from vnav.localisation.verdict.answer import PhotoAnswer, UnreadablePhoto

    Answers: TypeAlias = Sequence[PhotoAnswer | UnreadablePhoto]

CAMERA_HELP = (
    "Camera of the photos, a camera.toml, or 'auto' to estimate it. Without it: camera.toml beside"
    " the photo, its EXIF, the map's camera if the size is the same, else auto."
)


@click.command()
@click.argument("photos", nargs=-1, required=True, type=click.Path(path_type=Path))
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

    \b
    vnav locate photo.jpg --map my-map
    vnav locate photo.jpg --camera camera.toml --json
    vnav locate photos/ --csv poses.csv --overlay drawn/
    vnav locate thousands/ --json --scheduler tcp://10.0.0.1:8786
    """
    from vnav import config
    from vnav.api.map import open_map
    from vnav.io.photos.photo_files import find_photos
    from vnav.reporting.photo_table import write_csv

    require_one_way(jobs, scheduler)
    mapped, resolved = open_map(map_dir), config.load(config_source, settings)
    paths, alone = find_photos(photos), len(photos) == 1 and not photos[0].is_dir()
    pictures = _pictures(paths, overlay, alone) if overlay else {}
    answers: Answers
    if alone:
        answers = [mapped.locate(paths[0], camera=camera, config=resolved, remember=True)]
    else:
        found = mapped.locate_all(
            paths,
            camera=camera,
            config=resolved,
            jobs=jobs or 0,
            scheduler=scheduler,
            progress=console_progress(),
        )
        answers = list(found)
    _tell(answers, as_json, alone)
    _draw(mapped, answers, pictures)
    if csv_file:
        write_csv(csv_file, answers)
    return _exit_code(answers)


def _tell(answers: "Answers", as_json: bool, alone: bool) -> None:
    """Answers on stdout, what is doubtful about them on stderr."""
    from vnav.localisation.verdict.answer import PhotoAnswer, summary

    warned = set[str]()
    if as_json:
        said = [answer.as_dict() for answer in answers]
        click.echo(json.dumps(said[0] if alone else said, indent=1, allow_nan=False))
    for answer in answers:
        if not as_json:
            say(summary(answer))
        new = set(answer.warnings) - warned if isinstance(answer, PhotoAnswer) else set()
        for warning in sorted(new):
            warn(warning)
        warned |= new


def _pictures(photos: Sequence[Path], overlay: Path, alone: bool) -> dict[Path, Path]:
    """Which file each photo is drawn into, no photo among them; UsageError where that cannot be."""
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


def _draw(mapped: "Map", answers: "Answers", pictures: dict[Path, Path]) -> None:
    """A picture of each photo that could be read."""
    from vnav.localisation.verdict.answer import PhotoAnswer

    for answer in answers:
        if isinstance(answer, PhotoAnswer) and answer.path in pictures:
            mapped.draw_photo(answer, pictures[answer.path])


def _exit_code(answers: "Answers") -> int:
    """1 where a photo could not be read, 3 where one was not located."""
    from vnav.localisation.verdict.answer import PhotoAnswer

    read = [answer for answer in answers if isinstance(answer, PhotoAnswer)]
    if len(read) < len(answers):
        return 1
    return 0 if all(answer.located for answer in read) else 3
