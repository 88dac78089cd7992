"""Find where photos were taken."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from vnav.cli.options import (
    batch_options,
    config_options,
    console_progress,
    map_option,
    require_one_way,
)

if TYPE_CHECKING:
    from vnav.localisation.answer import PhotoAnswer, UnreadablePhoto
    from vnav.pipeline.locate_many import LocateTask

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
    from vnav.io.photos.photos import AUTO, find_photos
    from vnav.io.store.map_folder import MapFolder
    from vnav.localisation.answer import PhotoAnswer, UnreadablePhoto, summary
    from vnav.pipeline import locate_many as many
    from vnav.reporting import overlay as picture
    from vnav.reporting.photo_table import write_csv
    from vnav.stages import locate as stage

    require_one_way(jobs, scheduler)
    folder, resolved = MapFolder.open(map_dir), config.load(config_source, settings)
    of_all = Path(camera).absolute() if camera not in (None, AUTO) else camera
    locator = stage.Locator(folder, resolved, of_all)
    paths, alone = find_photos(photos), len(photos) == 1 and not photos[0].is_dir()
    answers: list[PhotoAnswer | UnreadablePhoto] = []
    if alone:
        answers.append(locator.locate(paths[0]))
    elif jobs or scheduler:
        asked = [path.absolute() for path in paths] if scheduler else paths
        shares = many.shares(asked, jobs or 0)
        tasks = [many.LocateTask(share, map_dir.absolute(), resolved, of_all) for share in shares]
        answers += _shared_out(tasks, jobs or 0, scheduler)
    else:
        answers += stage.locate(locator, paths, progress=console_progress())

    said = [answer.as_dict() for answer in answers] if as_json else []
    if as_json:
        click.echo(json.dumps(said[0] if alone else said, indent=1, allow_nan=False))
    for answer in answers:
        if not as_json:
            click.echo(summary(answer))
        if isinstance(answer, UnreadablePhoto):
            continue
        for warning in answer.warnings:
            click.echo(f"vnav: warning: {warning}", err=True)
        if overlay:
            file = overlay if alone else overlay / f"{answer.path.stem}.jpg"
            picture.draw(answer, locator.database, file)
    if csv_file:
        write_csv(csv_file, answers)
    if alone and (problem := stage.remember(folder, answers[0])):
        click.echo(f"vnav: warning: {problem}", err=True)
    return _exit_code(answers)


def _shared_out(
    tasks: "list[LocateTask]", jobs: int, scheduler: str
) -> "list[PhotoAnswer | UnreadablePhoto]":
    """Answers in the order of the photos, found in processes or on a cluster."""
    from vnav import batch
    from vnav.core.report import Failed
    from vnav.localisation.answer import UnreadablePhoto
    from vnav.pipeline.locate_many import locate_photos

    found: dict[int, list[PhotoAnswer | UnreadablePhoto]] = {}
    progress, count = console_progress(), sum(len(task.photos) for task in tasks)
    for k, result in batch.run(locate_photos, tasks, jobs=jobs, scheduler=scheduler):
        if isinstance(result, Failed):
            click.echo(result.traceback, err=True, nl=False)
            result = [UnreadablePhoto(path, result.reason) for path in tasks[k].photos]
        found[k] = result
        progress("locate", sum(map(len, found.values())), count)
    return [answer for k in range(len(tasks)) for answer in found[k]]


def _exit_code(answers: Sequence[object]) -> int:
    """1 where a photo could not be read, 3 where one was not located."""
    from vnav.localisation.answer import PhotoAnswer

    read = [answer for answer in answers if isinstance(answer, PhotoAnswer)]
    if len(read) < len(answers):
        return 1
    return 0 if all(answer.best is not None for answer in read) else 3
