"""Find where photos were taken."""

import json
from collections.abc import Sequence
from pathlib import Path

import click

from vnav.cli.options import config_options, console_progress, map_option

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
def locate(
    photos: tuple[Path, ...],
    map_dir: Path,
    config_source: str | None,
    settings: tuple[str, ...],
    camera: str | None,
    as_json: bool,
    csv_file: Path | None,
    overlay: Path | None,
) -> int:
    """Find where PHOTOS, or the photos in folders, were taken.

    Exit code 0: located, all of them; 3: not located, the reason is given; 1: an error, or a photo
    that cannot be read. The pose of a single located photo becomes the map's current place, where
    'vnav plan --from current' starts.

    \b
    vnav locate photo.jpg --map my-map
    vnav locate photo.jpg --camera camera.toml --json
    vnav locate photos/ --csv poses.csv --overlay drawn/
    """  # noqa: D301 - click reads the backspace as "do not wrap"
    from vnav import config
    from vnav.io.map_folder import MapFolder
    from vnav.io.photos import AUTO, find_photos
    from vnav.stages import locate as stage
    from vnav.stages import overlay as picture
    from vnav.stages.answer import Answer, Unreadable, summary, write_csv

    folder = MapFolder.open(map_dir)
    of_all = Path(camera) if camera not in (None, AUTO) else camera
    locator = stage.Locator(folder, config.load(config_source, settings), of_all)
    paths, alone = find_photos(photos), len(photos) == 1 and not photos[0].is_dir()
    answers: list[Answer | Unreadable] = []
    if alone:
        answers.append(locator.locate(paths[0]))
    else:
        answers += stage.locate(locator, paths, progress=console_progress())

    said = [answer.as_dict() for answer in answers] if as_json else []
    if as_json:
        click.echo(json.dumps(said[0] if alone else said, indent=1, allow_nan=False))
    for answer in answers:
        if not as_json:
            click.echo(summary(answer))
        if isinstance(answer, Unreadable):
            continue
        for warning in answer.warnings:
            click.echo(f"vnav: warning: {warning}", err=True)
        if overlay:
            file = overlay if alone else overlay / f"{answer.path.stem}.jpg"
            picture.draw(answer, locator.atlas, file)
    if csv_file:
        write_csv(csv_file, answers)
    if alone and (problem := stage.remember(folder, answers[0])):
        click.echo(f"vnav: warning: {problem}", err=True)
    return _exit_code(answers)


def _exit_code(answers: Sequence[object]) -> int:
    """1 where a photo could not be read, 3 where one was not located."""
    from vnav.stages.answer import Answer

    read = [answer for answer in answers if isinstance(answer, Answer)]
    if len(read) < len(answers):
        return 1
    return 0 if all(answer.best is not None for answer in read) else 3
