"""The entry point: one lazy group, and the one place that catches VnavError."""

import errno
import io
import os
import sys
from contextlib import suppress
from difflib import get_close_matches
from importlib import import_module
from keyword import iskeyword
from pathlib import Path

import click

from vnav import __version__
from vnav.cli import logs
from vnav.cli.options import loaded
from vnav.cli.say import say
from vnav.errors import INTERRUPTED, INTERRUPTION, VnavError, notes_of
from vnav.memory import keep_freed

UNREADABLE = errno.EACCES, errno.EPERM, errno.ENOENT, errno.EISDIR, errno.ENOTDIR
COMMANDS = {  # section of the help: command: its module
    "Map a place": {
        "build-map": "build_map",
        "extend": "extend",
        "odometry": "stage_commands",
        "vocabulary": "stage_commands",
        "loops": "stage_commands",
        "optimise": "stage_commands",
        "fuse": "stage_commands",
        "index": "stage_commands",
    },
    "Use a map": {"locate": "locate", "plan": "plan", "edit": "edit", "export": "export"},
    "Look at a map": {"info": "info", "report": "report", "view": "view"},
    "Check captures, results and settings": {
        "check": "check",
        "import": "import_recording",
        "calibrate": "calibrate",
        "score": "score",
        "evaluate": "evaluate",
        "datasets": "datasets",
        "tracks": "tracks",
        "config": "config",
        "demo": "demo",
        "doctor": "doctor",
    },
}
LONGEST_SUMMARY = 200  # characters: no summary is cut off
QUICK = {"locate", "plan"}  # load for longer than they work, and tell by `loaded` where they do not
NO_THREAD = "can't start new thread"  # Python's RuntimeError where memory is short
LAST_STREAM = 2  # descriptor of stderr


class LazyGroup(click.Group):
    """Imports a command's module only when that command is asked for."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Every command, in the order a user meets them."""
        return [name for section in COMMANDS.values() for name in section]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of that name, None where there is none."""
        module = next((names[cmd_name] for names in COMMANDS.values() if cmd_name in names), None)
        if module is None:
            return None
        if cmd_name not in QUICK:
            loaded()
        part, name = import_module(f"vnav.cli.{module}"), cmd_name.replace("-", "_")
        command: click.Command = getattr(part, f"{name}_" if iskeyword(name) else name)
        logs.add_options(command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that is asked for; UsageError tells those of a similar name."""
        try:
            return super().resolve_command(ctx, args)
        except click.UsageError as error:
            near = get_close_matches(args[0], self.list_commands(ctx))
            if not near:
                raise
            meant = f"{error.message} Did you mean {' or '.join(near)}?"
            raise click.UsageError(meant, ctx) from error

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write each section of commands, with whole summaries."""
        for section, names in COMMANDS.items():
            commands = [(name, self.get_command(ctx, name)) for name in names]
            with formatter.section(section):
                formatter.write_dl(
                    [(n, c.get_short_help_str(LONGEST_SUMMARY)) for n, c in commands if c]
                )


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__)
def cli() -> None:
    """Map a place from RGB-D frames, find a photo in it, plan a path to another photo."""


def _close_stdout() -> None:
    """What is still to be written there has nowhere to go, and shall not say so at the end."""
    with suppress(OSError):  # it is no file
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _open_closed_streams() -> None:
    """Give each standard stream a file: the next one opened would take a closed one's place."""
    while (descriptor := os.open(os.devnull, os.O_RDWR)) <= LAST_STREAM:
        pass
    os.close(descriptor)
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open(mode))  # noqa: SIM115 - for good


def _in_one_line(error: Exception) -> str | None:
    """What is said of an error, None of a bug; some libraries tell theirs in several lines."""
    is_bug = isinstance(error, ModuleNotFoundError | RuntimeError)
    if isinstance(error, MemoryError) or str(error) == NO_THREAD:
        return "expected more memory than there is; what was finished is kept"
    if is_bug:
        return None
    if isinstance(error, ImportError):
        return f"a library cannot be loaded: {error}; 'vnav doctor' tells more"
    if isinstance(error, OSError):
        where = f"{error.filename}: " if error.filename else ""
        kept = "" if error.errno in UNREADABLE else "; what was finished is kept"
        return f"{where}{error.strerror or error}{kept}"
    return " ".join(str(error).split("\n")).strip()


def main() -> int:
    """Run the command line; exit code 0, 1 (an error that is no bug), 2 (usage) or 3 (no)."""
    _open_closed_streams()
    keep_freed()
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")  # what it finds is told by vnav
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # and so of videos
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # which may know few characters
            stream.reconfigure(errors="backslashreplace")
    try:
        result = cli.main(standalone_mode=False)
        sys.stdout.flush()
    except BrokenPipeError:  # whoever read has enough; so does click end
        _close_stdout()
        return 1
    except click.Abort:  # a RuntimeError, too
        click.echo(INTERRUPTION, err=True)
        return INTERRUPTED
    except (VnavError, OSError, MemoryError, ImportError, RuntimeError) as error:
        told = _in_one_line(error)
        if told is None:
            raise
        if isinstance(error, OSError):
            _close_stdout()
        for line in (*notes_of(error), f"vnav: {told}"):
            say(line, err=True)
        return 1
    except click.ClickException as error:
        error.show()
        return error.exit_code
    return result if isinstance(result, int) else 0
