"""Options that several commands share, and how progress is shown."""

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from vnav.core.progress import Progress

Command = TypeVar("Command", bound=Callable[..., Any])

map_option = click.option(
    "--map",
    "map_dir",
    type=click.Path(path_type=Path),
    envvar="VNAV_MAP",
    default=Path("map"),
    show_default="$VNAV_MAP, else ./map",
    help="Folder of the map.",
)


def config_options(command: Command) -> Command:
    """Add --config and --set, which arrive as ``config_source`` and ``settings``."""
    for option in (
        click.option(
            "--set",
            "settings",
            multiple=True,
            metavar="SECTION.NAME=VALUE",
            help="Change one setting; may be given several times.",
        ),
        click.option(
            "--config",
            "config_source",
            metavar="PRESET|FILE",
            help="A preset that ships with vnav, or a TOML file with differences.",
        ),
    ):
        command = option(command)
    return command


def batch_options(command: Command) -> Command:
    """Add --jobs and --scheduler, which arrive as ``jobs`` (None: not given) and ``scheduler``."""
    for option in (
        click.option(
            "--scheduler",
            metavar="ADDRESS",
            default="",
            help="Send the work to a Dask cluster, like tcp://host:8786; needs vnav[cluster].",
        ),
        click.option(
            "--jobs",
            metavar="N",
            type=click.IntRange(min=1),
            help="How many to run at once, each in a process of its own.",
        ),
    ):
        command = option(command)
    return command


def require_one_way(jobs: int | None, scheduler: str) -> None:
    """UsageError where both ways of sharing the work are asked for."""
    if jobs and scheduler:
        raise click.UsageError("expected --jobs or --scheduler, found both")


def console_progress() -> Progress:
    """Progress on stderr: one line that rewrites itself, or sparse lines into a file."""
    started = time.monotonic()
    shown: dict[str, float] = {}
    live = sys.stderr.isatty()

    def show(task: str, done: int, total: int) -> None:
        now = time.monotonic()
        if done < total and now - shown.get(task, started - 60) < (0.1 if live else 10.0):
            return
        shown[task] = now
        end = "\n" if done >= total or not live else ""
        line = f"{task}: {done}/{total}  ({now - started:.0f} s)"
        click.echo(("\r\x1b[K" if live else "") + line + end, err=True, nl=False)

    return show
