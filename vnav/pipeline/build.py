"""From captures to a finished map: claim 3, every stage in its turn."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from vnav.checking.capture_report import require_usable
from vnav.config import Config
from vnav.core.progress import Progress, silent
from vnav.core.report import Report
from vnav.core.trajectory import Trajectory
from vnav.errors import CaptureError, ConfigError, MapError
from vnav.io.sources.capture import Capture
from vnav.io.store.map_folder import STAGES, MapFolder
from vnav.io.store.overview import has_verdict
from vnav.io.store.records import MappedCapture
from vnav.io.store.stage_reports import (
    Clock,
    clock,
    finished,
    peak_memory_mb,
    reused,
)
from vnav.memory import return_freed
from vnav.pipeline.connection import joins, with_joins
from vnav.pipeline.joining import TrackAll, forget_parts, track_together
from vnav.pipeline.quality import assess
from vnav.stages import odometry


@dataclass(frozen=True)
class BuiltMap:
    """A finished map: what is doubtful about its capture, and the reports of its stages."""

    warnings: tuple[str, ...]
    reports: list[Report]


def build(
    captures: Sequence[Capture],
    map_dir: Path,
    config: Config,
    track_all: TrackAll,
    *,
    given: Trajectory | None = None,
    fresh: bool = False,
    force: bool = False,
    progress: Progress = silent,
) -> BuiltMap:
    """Make one map of captures that are fit to be mapped; see `vnav.build_map`.

    ``track_all`` runs odometry of each, where there are several.
    """
    if given is None:
        expect_scale(config)
    expect_vocabulary(config)
    checked = [require_usable(c, force=force, progress=progress) for c in captures]
    folder = MapFolder.create(map_dir, fresh)
    if len(captures) == 1:
        (capture,), (found,) = captures, checked
        reports = build_map(folder, capture, config, given=given, progress=progress)
        return BuiltMap(found.warnings, reports)
    warnings = tuple(f"{found.name}: {told}" for found in checked for told in found.warnings)
    return BuiltMap(warnings, _build_together(folder, captures, config, track_all, progress))


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
    expect_captures(folder, [capture])
    tracked = odometry.run(folder, capture, config, given=given, progress=progress)
    forget_parts(folder)
    return _finished(folder, tracked, config, started, progress)


def _build_together(
    folder: MapFolder,
    captures: Sequence[Capture],
    config: Config,
    track_all: TrackAll,
    progress: Progress,
) -> list[Report]:
    """Run every stage on captures that are tracked alone, and all else together."""
    started = clock()
    expect_captures(folder, captures)
    entries = [odometry.described(k, capture) for k, capture in enumerate(captures)]
    _require_different(entries)
    tracked = track_together(folder, captures, entries, config, track_all)
    return _finished(folder, tracked, config, started, progress)


def _finished(
    folder: MapFolder,
    tracked: Report,
    config: Config,
    started: Clock,
    progress: Progress,
) -> list[Report]:
    """Run the stages after odometry; the reports of all, of the whole map, and the verdict."""
    reports = [tracked, *run_stages(folder, STAGES[1:], config, progress)]
    if has_verdict(folder) and all(report.reused for report in reports):
        return [*reports, reused(folder, "map"), reused(folder, "quality")]
    of_map = whole(folder)
    if len(folder.captures) > 1:
        of_map = with_joins(of_map, joins(folder))
    return [*reports, finished(folder, of_map, started), judged(folder, config)]


def run_stages(
    folder: MapFolder, stages: Sequence[str], config: Config, progress: Progress = silent
) -> list[Report]:
    """Run those of some stages after odometry that are not up to date; their reports in order.

    What those before have freed is returned first. Open3D is loaded while a stage computes that
    leaves a core to it.
    """
    modules, reports = [import_module(f"vnav.stages.{stage}") for stage in stages], list[Report]()
    with ThreadPoolExecutor(1) as loader:
        for stage, module in zip(stages, modules, strict=True):
            return_freed()
            if stage == "optimise" and not all(report.reused for report in reports):
                loader.submit(import_module, "vnav.volumes.tsdf")
            reports.append(module.run(folder, config, progress=progress))
    return reports


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


def expect_captures(folder: MapFolder, captures: Sequence[Capture]) -> None:
    """MapError where a map exists and was made of captures of other names."""
    made_of = [mapped["name"] for mapped in folder.captures]
    names = [capture.name for capture in captures]
    if made_of and made_of != names:
        raise MapError(
            f"expected {', '.join(made_of)}, of which the map {folder.root} was made, found"
            f" {', '.join(names)}; name another folder with --map, add a capture with 'vnav extend"
            f" {folder.root} CAPTURE', or start anew with --fresh"
        )


def _require_different(entries: Sequence[MappedCapture]) -> None:
    """CaptureError where two captures are the same."""
    first: dict[str, str] = {}
    for entry in entries:
        if entry["fingerprint"] in first:
            raise CaptureError(
                f"expected captures of different frames, found {first[entry['fingerprint']]} and"
                f" {entry['name']}, which have the same; name each once"
            )
        first[entry["fingerprint"]] = entry["name"]


def judged(folder: MapFolder, config: Config) -> Report:
    """The verdict on a finished map; a page about the map before does not outlast it."""
    started = clock()
    quality = assess(folder, config)
    folder.page.unlink(missing_ok=True)
    values = quality.values | {"inputs": folder.inputs_of("optimise")}
    return finished(folder, Report("quality", values, (quality.line,), quality.doubts), started)


def whole(folder: MapFolder) -> Report:
    """Size of the map and memory that it took."""
    size_mb, memory_mb = folder.size_mb(), peak_memory_mb()
    values = {"map_mb": size_mb, "peak_memory_mb": round(memory_mb)}
    lines = (f"{size_mb:.1f} MB on disk, peak memory {memory_mb:.0f} MB",)
    return Report("map", values, lines)
