"""``vnav locate``: where photos were taken."""

import csv
import json
import math
from pathlib import Path
from typing import Any

import click

from vnav import config
from vnav.cli.options import config_options, console_progress, map_option
from vnav.errors import PhotoError
from vnav.io.map_folder import MapFolder
from vnav.io.photos import photos_in
from vnav.stages.locate import PhotoReport
from vnav.stages.locate import locate as locate_photos
from vnav.stages.overlay import write_overlay

CAMERAS = {
    "camera": "as given",
    "camera.toml": "from camera.toml",
    "exif": "from EXIF",
    "map": "assumed to be the map's",
    "auto": "estimated",
}
COLUMNS = (
    *("photo", "located", "reason", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw", "inliers"),
    *("sigma_x_m", "sigma_y_m", "sigma_z_m"),
    *("sigma_rx_deg", "sigma_ry_deg", "sigma_rz_deg"),
)


@click.command(
    epilog="""\b
Examples:
  vnav locate photo.jpg
  vnav locate photo.jpg --camera phone.toml --overlay found.png
  vnav locate photos/ --csv poses.csv
  vnav locate photo.jpg --json | jq .position_m
""",
)
@click.argument("photos", nargs=-1, required=True, type=click.Path(path_type=Path))
@map_option
@config_options
@click.option(
    "--camera",
    metavar="FILE|auto",
    help="The photos' camera.toml, or auto: estimate the focal length. Default: the camera.toml"
    " beside a photo, else its EXIF, else the map's camera if the size is the same, else auto.",
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object a photo; several: an array.")
@click.option("--csv", "csv_file", type=click.Path(path_type=Path), help="Write a table of poses.")
@click.option(
    "--overlay",
    type=click.Path(path_type=Path),
    help="Draw what was recognised: a picture, or a folder where several photos are asked.",
)
@click.pass_context
def locate(
    ctx: click.Context,
    photos: tuple[Path, ...],
    map_dir: Path,
    config_source: str | None,
    settings: tuple[str, ...],
    camera: str | None,
    as_json: bool,
    csv_file: Path | None,
    overlay: Path | None,
) -> None:
    """Find where PHOTOS (files or folders) were taken in the map.

    Exit code 0: all located; 1: a photo cannot be read; 3: one was not located, or is ambiguous.
    """
    folder = MapFolder.open(map_dir)
    paths = photos_in(photos)
    resolved = config.load(config_source, settings)
    several = len(paths) > 1 or photos[0].is_dir()
    progress = console_progress()
    reports = locate_photos(folder, paths, resolved, camera=camera, progress=progress)
    if not several and isinstance(reports[0].answer, PhotoError):
        raise reports[0].answer
    values = [report.as_dict() for report in reports]
    if as_json:
        click.echo(json.dumps(values if several else values[0], indent=1))
    else:
        for report in reports:
            click.echo(told(report))
    if csv_file:
        write_csv(csv_file, values)
    if overlay:
        write_overlays(reports, overlay, several)
    if not several and reports[0].T_world_camera is not None:
        remember(folder, values[0])
    ctx.exit(exit_code(reports))


def write_overlays(reports: list[PhotoReport], target: Path, several: bool) -> None:
    """A picture of each photo that could be read; into a folder where there are several."""
    if several:
        target.mkdir(parents=True, exist_ok=True)
    for report in reports:
        if report.photo is not None:
            write_overlay(report, target / f"{report.path.stem}.png" if several else target)


def told(report: PhotoReport) -> str:
    """One line for people: where, how sure, or why not."""
    T = report.T_world_camera
    if T is None:
        return f"{report.path}: not located: {report.reason}"
    values = report.as_dict()
    x, y, z = values["position_m"]
    yaw_deg = math.degrees(math.atan2(T[1, 2], T[0, 2]))
    sigma_mm = 1000 * math.hypot(*values["sigma_position_m"])
    return (
        f"{report.path}: x {x:.3f} y {y:.3f} z {z:.3f} m, heading {yaw_deg:.1f} deg,"
        f" +- {sigma_mm:.0f} mm, {values['inliers']} inliers,"
        f" camera: {CAMERAS[values['intrinsics_source']]}"
    )


def write_csv(path: Path, values: list[dict[str, Any]]) -> None:
    """A row a photo; empty where it was not located."""
    with path.open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(COLUMNS)
        for v in values:
            pose = [*(v["position_m"] or [""] * 3), *(v["quaternion_xyzw"] or [""] * 4)]
            sigmas = [*(v["sigma_position_m"] or [""] * 3), *(v["sigma_rotation_deg"] or [""] * 3)]
            rows.writerow([v["photo"], v["located"], v["reason"], *pose, v["inliers"], *sigmas])


def remember(folder: MapFolder, values: dict[str, Any]) -> None:
    """Make a photo's pose the map's current one, or warn that the map cannot be written."""
    kept = {key: values[key] for key in ("photo", "T_world_camera", "sigma_position_m")}
    try:
        folder.write_current(kept)
    except OSError as error:
        click.echo(f"warning: the pose is not remembered as current: {error.strerror}", err=True)


def exit_code(reports: list[PhotoReport]) -> int:
    """0: all located; 1: one could not be read; 3: one was not located."""
    if any(isinstance(report.answer, PhotoError) for report in reports):
        return 1
    return 3 if any(report.T_world_camera is None for report in reports) else 0
