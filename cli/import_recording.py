"""Make a capture folder of a recording."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from vnav.cli.options import console_progress, warn
from vnav.cli.say import say

if TYPE_CHECKING:
    from vnav.io.recordings.importing import ImportedCapture


@click.command("import")
@click.argument("source", type=click.Path(path_type=Path))
@click.argument("out", type=click.Path(path_type=Path))
@click.option("--color", metavar="TOPIC", help="Colour images, where several may be meant.")
@click.option("--depth", metavar="TOPIC", help="Depth images, where several may be meant.")
@click.option("--camera-info", metavar="TOPIC", help="Camera of the colour images.")
@click.option("--registered", is_flag=True, help="Depth lies on the pixels of colour.")
@click.option(
    "--fixed-frame",
    metavar="FRAME",
    help="Frame of the poses that tf knows; by default the one that all others hang on.",
)
def import_(
    source: Path,
    out: Path,
    color: str | None,
    depth: str | None,
    camera_info: str | None,
    registered: bool,
    fixed_frame: str | None,
) -> None:
    """Write the images of the recording SOURCE into a new capture folder OUT.

    SOURCE is a bag of ROS 1 (.bag) or ROS 2 (its folder, .mcap, .db3). Topics are found by their
    types; where several may be meant, they are listed. Needs vnav-rgbd[ros].

    Poses that tf knows go to OUT/trajectory.tum. Damaged images are named and left out.

    \b
    vnav import kitchen.bag kitchen
    vnav import rosbag2_2026_11_23 lab --color /camera/color/image_raw
    vnav build-map lab --trajectory lab/trajectory.tum
    """
    from vnav.api.importing import import_capture

    imported = import_capture(
        source,
        out,
        color=color,
        depth=depth,
        camera_info=camera_info,
        registered=registered,
        fixed_frame=fixed_frame,
        progress=console_progress(),
    )
    _warn(imported)
    _show(imported)


def _warn(imported: "ImportedCapture") -> None:
    for reason in imported.skipped:
        warn(reason)
    if (others := imported.skipped_count - len(imported.skipped)) > 0:
        warn(f"{others} other images are skipped")
    if imported.other_cameras:
        warn(
            f"{imported.other_cameras} messages of {imported.camera_info} describe another camera"
            " than the first, which is used for all images"
        )
    if not imported.depth:
        warn("no depth was found; a map needs it")


def _show(imported: "ImportedCapture") -> None:
    camera = imported.camera
    width, height = camera.color.size
    say(f"colour   {imported.color_images} of {imported.color}, {width} x {height}")
    if imported.depth:
        width, height = (camera.depth or camera.color).size
        how = "registered" if camera.is_registered else "not registered"
        say(f"depth    {imported.depth_images} of {imported.depth}, {width} x {height}, {how}")
    say(f"camera   {imported.camera_info}")
    if imported.poses:
        say(
            f"poses    {imported.poses} in {imported.fixed_frame}: {imported.folder}/trajectory.tum"
        )
    say(f"capture  {imported.folder}")
