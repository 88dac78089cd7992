"""What a command says of its work, and where."""

import logging
from pathlib import Path
from types import SimpleNamespace

import click
import pytest
from click.testing import CliRunner, Result

import vnav
from vnav.cli import options
from vnav.cli.logs import NOTICES, add_options
from vnav.cli.options import console_progress, pace


@pytest.fixture
def command() -> click.Command:
    @click.command()
    def work() -> None:
        logging.getLogger("vnav.stages.odometry").info("60 of 60 frames tracked")
        logging.getLogger(NOTICES[0]).info("compiling, once")
        progress = console_progress()
        progress("odometry", 60, 60)
        click.echo("the result")

    add_options(work)
    return work


def run(command: click.Command, *arguments: object) -> Result:
    return CliRunner().invoke(command, [str(a) for a in arguments], catch_exceptions=False)


def test_without_options_there_are_progress_and_notices_but_no_log(command: click.Command) -> None:
    said = run(command)
    assert said.stdout == "the result\n"
    assert "odometry: 60/60" in said.stderr
    assert "vnav: compiling, once\n" in said.stderr
    assert "frames tracked" not in said.stderr


def test_verbose_logs_every_step_with_time_and_module(command: click.Command) -> None:
    said = run(command, "-v")
    assert "INFO vnav.stages.odometry: 60 of 60 frames tracked" in said.stderr
    assert said.stdout == "the result\n"


def test_locating_and_planning_log_what_they_found(
    whole_map: Path, tiny_capture: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "vnav")
    mapped, photo = vnav.open_map(whole_map), tiny_capture / "photos" / "000.jpg"
    mapped.plan(mapped.locate(photo), (0.0, 1e6))
    said = {record.name: record.getMessage() for record in caplog.records}
    assert said["vnav.stages.locate"].startswith(f"{photo}: at ")
    assert "vnav.stages.plan" in said


def test_quiet_leaves_results_only(command: click.Command) -> None:
    said = run(command, "-q")
    assert (said.stdout, said.stderr) == ("the result\n", "")


def test_a_log_file_is_appended_to(command: click.Command, tmp_path: Path) -> None:
    for _ in range(2):
        run(command, "--log-file", tmp_path / "log.txt")
    lines = (tmp_path / "log.txt").read_text("utf-8").splitlines()
    assert [line.split("vnav.")[1] for line in lines] == 2 * [
        "stages.odometry: 60 of 60 frames tracked",
        "compiled: compiling, once",
    ]


def test_a_log_file_that_cannot_be_written_is_wrong_usage(
    command: click.Command, tmp_path: Path
) -> None:
    said = run(command, "--log-file", tmp_path / "none" / "log.txt")
    assert said.exit_code == 2
    assert "expected a file that can be written" in said.stderr


def test_no_handler_outlives_its_command(command: click.Command) -> None:
    before = list(logging.getLogger("vnav").handlers)
    run(command, "-v")
    assert logging.getLogger("vnav").handlers == before


@pytest.mark.parametrize(
    ("done", "left", "seconds", "expected"),
    [
        (20, 100, 10.0, "  2/s, 50 s left"),
        (1, 9, 20.0, "  0.05/s, 3 min left"),
        (2, 598, 80.0, ""),
        (5, 595, 10.0, "  0.5/s, 20 min left"),
        (0, 100, 10.0, ""),
        (5, 100, 0.5, ""),
        (100, 0, 12.4, "  (12 s)"),
    ],
)
def test_progress_tells_rate_and_time_left(
    done: int, left: int, seconds: float, expected: str
) -> None:
    assert pace(done, left, seconds) == expected


def test_the_time_left_forgets_a_slow_start(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As that of a run that compiles first."""
    times_s = iter((0.0, 50.0, 60.0, 70.0, 116.0))
    monkeypatch.setattr(options, "time", SimpleNamespace(monotonic=lambda: next(times_s)))
    progress = console_progress()
    for done in (0, 2, 32, 62, 200):
        progress("odometry", done, 200)
    told = [line.partition("  ")[2] for line in capsys.readouterr().err.splitlines()]
    assert told[2:] == ["3/s, 56 s left", "3/s, 46 s left", "(116 s)"]


def test_a_command_that_is_asked_for_again_has_its_options_once(command: click.Command) -> None:
    before = list(command.params)
    add_options(command)
    assert command.params == before


def test_a_log_that_cannot_be_written_ends_the_command(command: click.Command) -> None:
    with pytest.raises(OSError, match="No space left"):
        run(command, "--log-file", "/dev/full")
