"""Calibrate a colour camera from images of a board."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from vnav.cli.options import console_progress, png_option, warn
from vnav.cli.say import say

if TYPE_CHECKING:
    from vnav.calibration.images import Calibration

WORST = 3  # images that are named, of those used
MOST_NAMED = 5  # of those left out for one reason


def _sides(_context: click.Context, _option: click.Parameter, squares: str) -> tuple[int, int]:
    """Columns and rows of 7x10; UsageError where it is none."""
    sides = squares.lower().split("x")
    if len(sides) != 2 or not all(side.isdecimal() for side in sides):
        raise click.BadParameter(f"expected squares as 7x10, found {squares}")
    return int(sides[0]), int(sides[1])


@click.command()
@click.argument("folder", required=False, type=click.Path(path_type=Path))
@click.option(
    "--kind",
    type=click.Choice(["charuco", "chessboard"]),
    default="charuco",
    show_default=True,
    help="A board with markers, which may be seen in part, or a chessboard.",
)
@click.option(
    "--squares",
    metavar="COLUMNSxROWS",
    callback=_sides,
    default="7x10",
    show_default=True,
    help="Squares, not corners: across, then down.",
)
@click.option(
    "--square-mm", type=float, default=25.0, show_default=True, help="Side of a square, measured."
)
@click.option(
    "--marker-mm", type=float, default=18.0, show_default=True, help="Side of a marker (charuco)."
)
@click.option(
    "--dictionary",
    default="4X4_50",
    show_default=True,
    help="OpenCV's dictionary of the markers (charuco), such as 5X5_100 or APRILTAG_36h11.",
)
@click.option(
    "--print",
    "page_file",
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="Write the board to print at 100 %: a .pdf, .svg or .png.",
)
@click.option(
    "--out",
    metavar="FILE",
    type=click.Path(path_type=Path),
    show_default="FOLDER/camera.toml",
    help="File to write the camera to.",
)
@click.option("--force", is_flag=True, help="Replace the file that is there.")
@click.option(
    "--units-per-metre",
    type=click.FloatRange(min=0, min_open=True),
    help="Of depth on the pixels of colour, 1000 for millimetres, for [depth] of the file.",
)
@png_option("Draw corners, residuals and an undistorted image, too, into a .png.")
@click.option("--json", "as_json", is_flag=True, help="Print everything as one JSON object.")
def calibrate(
    folder: Path | None,
    kind: str,
    squares: tuple[int, int],
    square_mm: float,
    marker_mm: float,
    dictionary: str,
    page_file: Path | None,
    out: Path | None,
    force: bool,
    units_per_metre: float | None,
    png_file: Path | None,
    as_json: bool,
) -> None:
    """Find the colour camera that took the images of a board in FOLDER, and write camera.toml.

    FOLDER holds images, or is a capture. 20 images are good: the board in all parts of the image,
    tilted by up to 45 degrees to all sides, sharp, with the focus locked. Images without the
    board, blurred ones and outliers are left out and named.

    \b
    vnav calibrate --print board.pdf
    vnav calibrate board_photos --png calibration.png
    vnav calibrate board_photos --kind chessboard --squares 10x7 --square-mm 30
    """
    from vnav.api.calibrating import calibrate as run
    from vnav.calibration.board import Board

    board = Board(kind, *squares, square_mm / 1e3, marker_mm / 1e3, dictionary)
    if folder is None and page_file is None:
        raise click.UsageError("expected a FOLDER of images, or --print FILE")
    if page_file is not None:
        from vnav.reporting.board_page import write_board

        write_board(board, page_file)
        say(f"board    {page_file}", err=as_json)
    if folder is None:
        return
    file = out or folder / "camera.toml"
    found = run(
        folder,
        board,
        out=file,
        force=force,
        units_per_metre=units_per_metre,
        picture=png_file,
        progress=console_progress(),
    )
    _show(found, file, as_json)


def _show(found: "Calibration", file: Path, as_json: bool) -> None:
    if as_json:
        click.echo(json.dumps(found.as_dict() | {"camera_file": str(file)}, indent=1))
        return
    for line in (*_left_out(found), *_lines(found)):
        say(line)
    for warning in found.warnings:
        warn(warning)
    say(f"camera   {file}")


def _left_out(found: "Calibration") -> Iterator[str]:
    """A line for each reason, with the first images that it holds for."""
    names: dict[str, list[str]] = {}
    for name, why in found.left_out.items():
        names.setdefault(why, []).append(name)
    for why, those in names.items():
        more = ", ..." * (len(those) > MOST_NAMED)
        yield f"left out {len(those)}: {why} ({', '.join(those[:MOST_NAMED])}{more})"


def _lines(found: "Calibration") -> list[str]:
    from vnav.calibration.estimate import PARAMETERS

    camera = found.camera
    width, height = camera.intrinsics.size
    known = camera.intrinsics
    values = (known.fx, known.fy, known.cx, known.cy, *known.distortion)
    terms = [
        f"{name} {value:.{digits}f} +- {sigma:.{digits}f}" if sigma else f"{name} 0"
        for name, value, sigma, digits in zip(
            PARAMETERS, values, camera.sigmas, [2] * 4 + [4] * 5, strict=True
        )
    ]
    worst = sorted(camera.fitted, key=lambda each: -each.rms_px)[:WORST]
    names = ", ".join(f"{each.view.path.name} {each.rms_px:.2f}" for each in worst)
    tilt_deg = max(each.tilt_deg for each in camera.fitted)
    used = len(camera.fitted)
    return [
        f"images   {used} of {used + len(found.left_out)} used, {width} x {height}",
        f"corners  {sum(len(each.view.px) for each in camera.fitted)}, on"
        f" {found.covered_share:.0%} of the image; board tilted by up to {tilt_deg:.0f} degrees",
        f"off      RMS {camera.rms_px:.2f} px; worst: {names}",
        f"pinhole  {', '.join(terms[:4])} px",
        f"lens     {', '.join(terms[4:])}",
    ]
