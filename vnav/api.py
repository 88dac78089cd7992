"""What the commands and other programs call: a map is built, extended, and drawn."""

from vnav.config import Config
from vnav.core.progress import Progress, silent
from vnav.core.report import Report
from vnav.io.sources.capture import Capture
from vnav.io.store.map_folder import MapFolder
from vnav.pipeline.build import BuildTask, BuiltMap, build


def build_map(task: BuildTask, progress: Progress = silent) -> BuiltMap:
    """Make the map of one capture, and its pictures; VnavError where there is none to be made."""
    from vnav.reporting import map_pictures

    built = build(task, progress)
    map_pictures.draw(MapFolder(task.map_dir))
    return built


def extend_map(
    folder: MapFolder,
    capture: Capture,
    config: Config,
    *,
    force: bool = False,
    progress: Progress = silent,
) -> BuiltMap:
    """Add a capture to a map, and draw its pictures anew; CaptureError where it does not fit."""
    from vnav.pipeline import extend
    from vnav.reporting import map_pictures

    extended = extend.extend(folder, capture, config, force=force, progress=progress)
    map_pictures.draw(folder)
    return extended


def fuse(folder: MapFolder, config: Config, *, progress: Progress = silent) -> Report:
    """Run the stage fuse alone, and draw the map's pictures anew."""
    from vnav.reporting import map_pictures
    from vnav.stages import fuse as stage

    report = stage.run(folder, config, progress=progress)
    map_pictures.draw(folder)
    return report
