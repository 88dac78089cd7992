"""Options that several commands share, and how progress is shown."""

import gc
import sys
import time
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar

import click
from click.core import ParameterSource

from vnav.cli.logs import is_quiet
from vnav.cli.say import printable, say
from vnav.core.progress import Progress, silent

Command = TypeVar("Command", bound=Callable[..., Any])
ENOUGH = 5  # that are done tell a rate: the first may have waited for what is compiled
LATELY_S = 10.0  # a rate is that of the last 10 to 20 s: runs that compile start slowly

map_option = click.option(
    "--map",
    "map_dir",
    type=click.Path(path_type=Path),
    envvar="VNAV_MAP",
    default=Path("map"),
    show_default="$VNAV_MAP, else ./map",
    help="Folder of the map.",
)


def png_option(help: str) -> Callable[[Command], Command]:
    """Add --png FILE, which arrives as ``png_file``."""
    path = click.Path(path_type=Path)
    return click.option("--png", "png_file", type=path, callback=_named_png, help=help)


def _named_png(_context: click.Context, _option: click.Parameter, path: Path | None) -> Path | None:
    """UsageError where a picture would get the name of something else."""
    is_device = path is not None and path.exists() and not path.is_file()
    if path is not None and path.suffix.lower() != ".png" and not is_device:
        raise click.BadParameter(f"expected a name that ends in .png, found {path}")
    return path


def map_argument_or_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add [MAP] and --map, of which one at most is given, and which arrives as ``map_dir``."""

    @wraps(command)
    def with_one(map_named: Path | None, map_dir: Path, **others: Any) -> Any:
        source = click.get_current_context().get_parameter_source("map_dir")
        if map_named is not None and source is ParameterSource.COMMANDLINE:
            raise click.UsageError("expected the map as MAP or with --map, found both")
        return command(map_dir=map_named or map_dir, **others)

    argument = click.argument(
        "map_named", metavar="[MAP]", required=False, type=click.Path(path_type=Path)
    )
    return argument(map_option(with_one))


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
            help="Send the work to a Dask cluster, like tcp://host:8786; needs vnav-rgbd[cluster].",
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


def loaded() -> None:
    """Seek garbage again where it was not while a command was loaded, and not in what was."""
    if not gc.isenabled():
        gc.freeze()
        gc.enable()


def warn(warning: str) -> None:
    """A warning on stderr."""
    say(f"vnav: warning: {warning}", err=True)


def console_progress() -> Progress:
    """Progress on stderr: one line that rewrites itself, or sparse lines into a file."""
    return silent if is_quiet() else _ConsoleProgress()


class _ConsoleProgress:
    """How far each task is, how fast it goes of late, and how long it will take."""

    def __init__(self) -> None:
        self._live = sys.stderr.isatty()
        self._marks: dict[str, list[tuple[float, int]]] = {}  # of each task: when, what was done
        self._shown: dict[str, float] = {}

    def __call__(self, task: str, done: int, total: int) -> None:
        now = time.monotonic()
        marks = self._marks.setdefault(task, [(now, done)])
        if now - marks[-1][0] >= LATELY_S:
            marks.append((now, done))
        wait_s = 0.1 if self._live else 10.0
        if done < total and now - self._shown.get(task, now - 60) < wait_s:
            return
        self._shown[task] = now
        end = "\n" if done >= total or not self._live else ""
        since_s, first = marks[0] if done >= total else marks[max(len(marks) - 2, 0)]
        rate = pace(done - first, total - done, now - since_s)
        line = printable(f"{task}: {done}/{total}{rate}")
        click.echo(("\r\x1b[K" if self._live else "") + line + end, err=True, nl=False)


def pace(done: int, left: int, seconds: float) -> str:
    """Rate and time left, or time taken where nothing is left; empty while it cannot be told."""
    if left <= 0:
        return f"  ({seconds:.0f} s)"
    if done < max(1, min(ENOUGH, (done + left) // 20)) or seconds < 1:
        return ""
    rate = done / seconds
    left_s = left / rate
    remaining = f"{left_s:.0f} s" if left_s < 90 else f"{left_s / 60:.0f} min"
    return f"  {rate:.3g}/s, {remaining} left"
