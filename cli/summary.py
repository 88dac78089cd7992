"""Stage reports as a person reads them."""

from collections.abc import Iterable

import click

from vnav.core.report import Report


def show(reports: Iterable[Report]) -> None:
    """Print a block for each stage on stdout: what it found, its warnings, its seconds."""
    for report in reports:
        time = "up to date" if report.reused else f"{report.seconds:.1f} s"
        first, *others = report.lines or ("done",)
        click.echo(f"{report.stage:12}{first} ({time})")
        for line in others:
            click.echo(f"{'':12}{line}")
        for warning in report.warnings:
            click.echo(f"{'':12}warning: {warning}")
