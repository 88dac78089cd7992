"""From a capture to a finished map: claim 3, every stage in its turn."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from vnav.checking.capture_report import require_usable
from vnav.config import Config
from vnav.core.progress import Progress, silent
from vnav.core.report import Report
from vnav.core.trajectory import Trajectory
from vnav.errors import ConfigError, MapError
from vnav.io.sources.capture import Capture
from vnav.io.store.map_folder import STAGES, MapFolder
from vnav.io.store.overview import has_verdict
from vnav.io.store.stage_reports import clock, finished, peak_memory_mb, reused
from vnav.pipeline.quality import assess


@dataclass(frozen=True)
class BuiltMap:
    """A finished map: what is doubtful about its capture, and the reports of its stages."""

    warnings: tuple[str, ...]
    reports: list[Report]


def build(
    capture: Capture,
    map_dir: Path,
    config: Config,
    *,
    given: Trajectory | None = None,
    fresh: bool = False,
    force: bool = False,
    progress: Progress = silent,
) -> BuiltMap:
    """Make the map of a capture that is fit to be mapped; see `vnav.build_map`."""
    if given is None:
        expect_scale(config)
    expect_vocabulary(config)
    checked = require_usable(capture, force=force, progress=progress)
    folder = MapFolder.create(map_dir, fresh)
    reports = build_map(folder, capture, config, given=given, progress=progress)
    return BuiltMap(checked.warnings, reports)


def build_map(
    folder: MapFolder,
    capture: Capture,
    config: Config,
    *,
    given: Trajectory | None = None,
    progress: Progress = silent,
) -> list[Report]:
    """Run every stage that is not up to date; their reports in order, the verdict on the map last.

    With ``given`` poses, the map is made at these.
    MapError where the map was made of others.
    """
    started = clock()
    expect_capture(folder, capture)
    from vnav.stages import odometry

    tracked = odometry.run(folder, capture, config, given=given, progress=progress)
    reports = [tracked, *run_stages(folder, STAGES[1:], config, progress)]
    if has_verdict(folder) and all(report.reused for report in reports):
        return [*reports, reused(folder, "map"), reused(folder, "quality")]
    return [*reports, finished(folder, whole(folder), started), judged(folder, config)]


def run_stages(
    folder: MapFolder, stages: Sequence[str], config: Config, progress: Progress = silent
) -> list[Report]:
    """Run those of some stages after odometry that are not up to date; their reports in order."""
    modules = [import_module(f"vnav.stages.{stage}") for stage in stages]
    return [module.run(folder, config, progress=progress) for module in modules]


def expect_scale(config: Config) -> None:
    """ConfigError where tracking would give no lengths in metres."""
    if not config.tracking.has_scale:
        raise ConfigError(
            "expected settings that give lengths in metres, found tracking.ekf.depth = false: a map"
            " needs depth; use --config ekf, or 'vnav odometry CAPTURE --config mono' alone"
        )


def expect_vocabulary(config: Config) -> None:
    """ConfigError where the descriptors are such that the vocabulary's method cannot hold them."""
    if config.vocabulary.method == "approximate":
        from vnav.features import front_end
        from vnav.vocabulary.approximate import expect_numbers

        expect_numbers(front_end(config.features).space)


def expect_capture(folder: MapFolder, capture: Capture) -> None:
    """MapError where a map exists and was made of a capture of another name, or of several."""
    made_of = [mapped["name"] for mapped in folder.captures]
    if made_of and made_of != [capture.name]:
        raise MapError(
            f"expected {', '.join(made_of)}, of which the map {folder.root} was made, found"
            f" {capture.name}; name another folder with --map, add a capture with 'vnav extend"
            f" {folder.root} CAPTURE', or start anew with --fresh"
        )


def judged(folder: MapFolder, config: Config) -> Report:
    """The verdict on a finished map."""
    started = clock()
    quality = assess(folder, config)
    values = quality.values | {"inputs": folder.inputs_of("optimise")}
    return finished(folder, Report("quality", values, (quality.line,), quality.doubts), started)


def whole(folder: MapFolder) -> Report:
    """Size of the map and memory that it took."""
    size_mb, memory_mb = folder.size_mb(), peak_memory_mb()
    values = {"map_mb": size_mb, "peak_memory_mb": round(memory_mb)}
    lines = (f"{size_mb:.1f} MB on disk, peak memory {memory_mb:.0f} MB",)
    return Report("map", values, lines)
