"""Stage reports as a person reads them."""

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from vnav.cli.options import warn
from vnav.cli.say import say
from vnav.core.report import Report

if TYPE_CHECKING:
    from vnav.pipeline.build import BuiltMap


def show_map(map_dir: Path, built: "BuiltMap") -> None:
    """Print what building a map found, and where it is."""
    for warning in built.warnings:
        warn(warning)
    *stages, quality = built.reports
    show(stages)
    say(f"map in {map_dir}, pictures in {map_dir / 'reports'}")
    show([quality])


def show(reports: Iterable[Report]) -> None:
    """Print a block for each stage on stdout: what it found, its warnings, its seconds."""
    for report in reports:
        time = "up to date" if report.reused else f"{report.seconds:.1f} s"
        first, *others = report.lines or ("done",)
        say(f"{report.stage:12}{first} ({time})")
        for line in others:
            say(f"{'':12}{line}")
        for warning in report.warnings:
            say(f"{'':12}warning: {warning}")
