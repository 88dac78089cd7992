"""What every stage of a map shares: its recorded settings, and its report."""

import dataclasses
import time
from typing import Any

from vnav.config import Config
from vnav.core.report import Report
from vnav.io.map_folder import MapFolder


def settings_of(config: Config, *sections: str) -> dict[str, Any]:
    """The seed and the named sections, as plain values: what a stage's result depends on."""
    values = {name: dataclasses.asdict(getattr(config, name)) for name in sections}
    return {"seed": config.seed, **values}


def reused(folder: MapFolder, stage: str) -> Report:
    """The last report of a stage that is up to date."""
    last = folder.report(stage)
    lines, warnings = tuple(last.get("lines", ())), tuple(last.get("warnings", ()))
    return Report(stage, last.get("values", {}), lines, warnings, 0.0, reused=True)


def finished(folder: MapFolder, report: Report, started: float) -> Report:
    """The report with its seconds since ``started`` (time.monotonic), kept in the map."""
    report = dataclasses.replace(report, seconds=round(time.monotonic() - started, 3))
    folder.write_report(report.stage, report.as_dict())
    return report
