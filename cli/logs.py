"""What is said of the work besides its results: -v, -q and --log-file, on every command."""

import logging
from pathlib import Path

import click

FORMAT = "%(asctime)s %(levelname)s %(name)s: %(message)s"
# A person waits for these: they are said although no log was asked for.
NOTICES = ("vnav.compiled", "vnav.api.judging")
QUIET = "vnav.cli.quiet"


def add_options(command: click.Command) -> None:
    """Give a command -v, -q and --log-file; what they set up ends with the command."""
    command.params += [option for option in _OPTIONS if option not in command.params]


def is_quiet() -> bool:
    """Whether the command that runs was asked to show no progress."""
    context = click.get_current_context(silent=True)
    return context is not None and bool(context.meta.get(QUIET))


def _be_quiet(context: click.Context, _option: click.Parameter, quiet: bool) -> None:
    context.meta[QUIET] = quiet


def _log_to_stderr(context: click.Context, _option: click.Parameter, verbose: bool) -> None:
    """All of the log, or what a person waits for alone."""
    handler = logging.StreamHandler()
    if verbose:
        handler.setFormatter(logging.Formatter(FORMAT))
    else:
        handler.setFormatter(logging.Formatter("vnav: %(message)s"))
        handler.addFilter(lambda record: record.name in NOTICES and not is_quiet())
    _attach(context, handler)


def _log_to_file(context: click.Context, _option: click.Parameter, path: Path | None) -> None:
    if path is None:
        return
    try:
        handler = _LogFile(path, encoding="utf-8")
    except OSError as error:
        raise click.BadParameter(
            f"expected a file that can be written, found: {error.strerror}: {path}"
        ) from error
    handler.setFormatter(logging.Formatter(FORMAT))
    _attach(context, handler)


class _LogFile(logging.FileHandler):
    """A file whose errors end the command: a log that was asked for is not left out in silence."""

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 - logging's name
        """Raise what kept a record from being written."""
        raise


def _attach(context: click.Context, handler: logging.Handler) -> None:
    """Send vnav's log to a handler until the command ends."""
    logger = logging.getLogger("vnav")
    logger.setLevel(logging.INFO)
    logger.addHandler(handler)
    context.call_on_close(lambda: _detach(logger, handler))


def _detach(logger: logging.Logger, handler: logging.Handler) -> None:
    logger.removeHandler(handler)
    handler.close()


_OPTIONS = (
    click.Option(
        ["-v", "--verbose"],
        is_flag=True,
        expose_value=False,
        callback=_log_to_stderr,
        help="Log every step on stderr.",
    ),
    click.Option(
        ["-q", "--quiet"],
        is_flag=True,
        expose_value=False,
        callback=_be_quiet,
        help="Show no progress and no notices.",
    ),
    click.Option(
        ["--log-file"],
        metavar="FILE",
        type=click.Path(path_type=Path, dir_okay=False),
        expose_value=False,
        callback=_log_to_file,
        help="Append the log of every step to this file.",
    ),
)
