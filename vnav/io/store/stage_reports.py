"""What every stage of a map shares: its recorded settings, and its report."""

import dataclasses
import logging
import re
import resource
import time
from pathlib import Path
from typing import Any

from vnav.config import Config
from vnav.core.report import Report
from vnav.io.store.map_folder import MapFolder

Clock = tuple[float, float]


def settings_of(config: Config, *sections: str) -> dict[str, Any]:
    """The seed and the named sections, as plain values: what a stage's result depends on."""
    values = {name: dataclasses.asdict(getattr(config, name)) for name in sections}
    return {"seed": config.seed, **values}


def reused(folder: MapFolder, stage: str) -> Report:
    """The last report of a stage that is up to date."""
    last = folder.report(stage)
    lines, warnings = tuple(last.get("lines", ())), tuple(last.get("warnings", ()))
    report = Report(stage, last.get("values", {}), lines, warnings, reused=True)
    _log(report)
    return report


def _log(report: Report) -> None:
    """A line of the stage's log for each of its report's."""
    log = logging.getLogger(f"vnav.stages.{report.stage}")
    took = "up to date" if report.reused else f"{report.seconds:.1f} s"
    log.info("%s (%s)", "; ".join(report.lines), took)
    for warning in report.warnings:
        log.warning(warning)


def clock() -> Clock:
    """Seconds that went by, and seconds of CPU of all threads of this process."""
    return time.monotonic(), time.process_time()


def finished(folder: MapFolder, report: Report, started: Clock) -> Report:
    """The report with its seconds since ``started``, kept in the map."""
    wall_s, cpu_s = (round(end - begin, 3) for begin, end in zip(started, clock(), strict=True))
    report = dataclasses.replace(report, seconds=wall_s, cpu_seconds=cpu_s)
    folder.write_report(report.stage, report.as_dict())
    _log(report)
    return report


def peak_memory_mb() -> float:
    """The most memory that this process has had, in MB of 2^20 bytes.

    Linux tells of this program alone; elsewhere what started the process may count, too.
    """
    status = Path("/proc/self/status")
    found = re.search(r"VmHWM:\s*(\d+) kB", status.read_text()) if status.is_file() else None
    kilobytes = int(found[1]) if found else resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return kilobytes / 1024
