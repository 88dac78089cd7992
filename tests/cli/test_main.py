import errno
import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path
from types import ModuleType

import click
import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from vnav.cli import main as entry
from vnav.errors import MapError


def run(monkeypatch: pytest.MonkeyPatch, body: object, *arguments: str) -> int:
    """Exit code of ``vnav try`` whose body returns, or raises, what it is given."""

    @click.command(name="try")
    def attempt() -> object:
        if isinstance(body, BaseException):
            raise body
        return body

    module = ModuleType("vnav.cli.attempt")
    module.attempt = attempt  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.setattr(entry, "COMMANDS", {"Try": {"attempt": "attempt"}})
    monkeypatch.setattr(sys, "argv", ["vnav", "attempt", *arguments])
    return entry.main()


def test_a_command_that_returns_nothing_exits_with_0(monkeypatch: pytest.MonkeyPatch) -> None:
    assert run(monkeypatch, None) == 0


def test_a_commands_own_exit_code_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    assert run(monkeypatch, 3) == 3


def test_an_error_a_user_can_mend_is_one_line_on_stderr_and_exits_with_1(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, MapError("expected a map, found none")) == 1
    assert capsys.readouterr() == ("", "vnav: expected a map, found none\n")


def test_an_error_of_the_system_is_one_line_on_stderr_and_exits_with_1(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    full = OSError(errno.ENOSPC, "No space left on device", "/mnt/table.csv")
    assert run(monkeypatch, full) == 1
    said = "vnav: /mnt/table.csv: No space left on device; what was finished is kept\n"
    assert capsys.readouterr() == ("", said)


def test_what_cannot_be_read_has_nothing_that_is_kept(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, PermissionError(errno.EACCES, "Permission denied", "map.json")) == 1
    assert capsys.readouterr() == ("", "vnav: map.json: Permission denied\n")


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (OSError("cannot load libLLVM.so"), "cannot load libLLVM.so; what was finished is kept"),
        (RuntimeError("can't start new thread"), "expected more memory than there is; what"),
        (MemoryError(), "expected more memory than there is; what was finished is kept"),
        (
            ImportError("libGL.so.1: none"),
            "a library cannot be loaded: libGL.so.1: none; 'vnav doc",
        ),
    ],
)
def test_what_the_machine_lacks_is_one_line(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    error: Exception,
    said: str,
) -> None:
    assert run(monkeypatch, error) == 1
    told = capsys.readouterr().err
    assert told.startswith(f"vnav: {said}")
    assert told.count("\n") == 1


@pytest.mark.parametrize("bug", [ModuleNotFoundError("vnav.io.nothing"), RuntimeError("a bug")])
def test_other_errors_of_these_kinds_are_bugs(
    monkeypatch: pytest.MonkeyPatch, bug: Exception
) -> None:
    with pytest.raises(type(bug)):
        run(monkeypatch, bug)


def test_a_bug_keeps_its_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ZeroDivisionError):
        run(monkeypatch, ZeroDivisionError())


def test_an_interrupted_run_says_that_finished_stages_are_kept(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, KeyboardInterrupt()) == 130
    assert "what was finished is kept" in capsys.readouterr().err


def test_wrong_usage_exits_with_2(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, None, "--no-such-option") == 2
    assert "--no-such-option" in capsys.readouterr().err


def test_a_full_device_on_stdout_is_told_once(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "vnav", "config"]
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(command, cwd=tmp_path, stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 1
    assert done.stderr == "vnav: No space left on device; what was finished is kept\n"


def test_a_reader_who_has_enough_is_no_error(tmp_path: Path) -> None:
    command = f"set -o pipefail; {sys.executable} -m vnav config | head -1"
    done = subprocess.run(["bash", "-c", command], cwd=tmp_path, text=True, capture_output=True)
    assert (done.returncode, done.stderr) in ((0, ""), (1, ""))
    assert done.stdout.count("\n") == 1


def vnav(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "vnav", *arguments]
    return subprocess.run(command, cwd=cwd, text=True, capture_output=True, check=False)


def test_the_process_exits_with_the_code_of_the_command_line(tmp_path: Path) -> None:
    assert vnav("--version", cwd=tmp_path).returncode == 0
    assert vnav("no-such-command", cwd=tmp_path).returncode == 2
    missing = vnav("info", "no-such-map", cwd=tmp_path)
    assert (missing.returncode, missing.stdout) == (1, "")
    assert missing.stderr.startswith("vnav: expected a map at")
    assert missing.stderr.count("\n") == 1


NAMES = entry.cli.list_commands(click.Context(entry.cli))


@pytest.mark.parametrize("command", NAMES)
def test_every_command_explains_itself_with_an_example(command: str) -> None:
    found = entry.cli.get_command(click.Context(entry.cli), command)
    assert isinstance(found, click.Command)
    assert found.name == command
    assert any(line.split()[:2] == ["vnav", command] for line in str(found.help).splitlines())
    for parameter in found.params:
        if isinstance(parameter, click.Option):
            assert parameter.help, f"{command} {parameter.opts} has no help"


def test_the_list_of_commands_shows_the_whole_summary_of_every_one_of_them() -> None:
    shown = CliRunner().invoke(entry.cli, ["--help"]).stdout
    assert "..." not in shown.removeprefix("Usage: cli [OPTIONS] COMMAND [ARGS]...")
    for command in NAMES:
        assert f"\n  {command} " in shown


@pytest.mark.parametrize(
    ("asked", "meant"), [("buld-map", "Did you mean build-map?"), ("qqq", "'qqq'.\n")]
)
def test_a_command_of_a_similar_name_is_proposed(asked: str, meant: str) -> None:
    result = CliRunner().invoke(entry.cli, [asked])
    assert result.exit_code == 2
    assert meant in result.stderr


def test_a_shell_completes_commands(tmp_path: Path) -> None:
    words = {"_VNAV_COMPLETE": "bash_complete", "COMP_WORDS": "vnav buil", "COMP_CWORD": "1"}
    program = Path(sys.executable).with_name("vnav")
    done = subprocess.run([program], env=os.environ | words, capture_output=True, text=True)
    assert done.stdout == "plain,build-map\n"


def test_no_command_at_all_shows_the_help_and_is_wrong_usage(tmp_path: Path) -> None:
    shown = vnav(cwd=tmp_path)
    assert shown.returncode == 2
    assert "build-map" in shown.stderr


def test_closed_streams_are_no_bug(tmp_path: Path) -> None:
    for closed in ("<&-", ">&-", "2>&-", "<&- >&- 2>&-"):
        command = f"exec {sys.executable} -m vnav config {closed}"
        done = subprocess.run(["bash", "-c", command], cwd=tmp_path, text=True, capture_output=True)
        assert (done.returncode, done.stderr) == (0, ""), closed


def test_what_a_library_tells_in_lines_is_told_in_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, MapError("expected a map, found:\nan end\n")) == 1
    assert capsys.readouterr() == ("", "vnav: expected a map, found: an end\n")


def test_opencv_adds_nothing_to_the_one_line(tmp_path: Path) -> None:
    photo = tmp_path / "photo.tif"
    cv2.imwrite(str(photo), np.zeros((40, 60), np.uint8))
    photo.write_bytes(photo.read_bytes()[:60])
    code = (
        "import sys; sys.argv = ['vnav', '--version']; from vnav.cli.main import main; main()\n"
        "from pathlib import Path; from vnav.io.formats.images import read_image\n"
        f"read_image(Path({str(photo)!r}))"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=tmp_path, text=True, capture_output=True)
    assert "expected an image" in done.stderr
    assert "[ERROR" not in done.stderr
    assert "[ WARN" not in done.stderr


def test_an_interruption_while_the_command_line_is_loaded_is_told(tmp_path: Path) -> None:
    code = """
import sys
class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == "click":
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupting())
from vnav.__main__ import run
sys.exit(run())
"""
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=tmp_path, text=True, capture_output=True)
    assert done.returncode == 130
    assert done.stderr == "vnav: interrupted; what was finished is kept\n"


def interrupted(tmp_path: Path, body: str) -> subprocess.CompletedProcess[str]:
    """The end of a command line whose command is ``body``, in a process of its own."""
    code = f"""
import os, signal, sys, types
command = types.ModuleType("vnav.cli.main")
def main():
    {textwrap.indent(textwrap.dedent(body).strip(), "    ").strip()}
command.main = main
sys.modules[command.__name__] = command
from vnav import __main__
__main__.ONCE_S = 0.2
def interrupt():
    os.kill(os.getpid(), signal.SIGINT)
sys.exit(__main__.run())
"""
    return subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        text=True,
        capture_output=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )


def test_what_interrupts_twice_at_once_does_not_break_off_the_tidying_up(tmp_path: Path) -> None:
    done = interrupted(
        tmp_path,
        """
        try:
            interrupt()
        finally:
            interrupt()
            print("tidied up")
        """,
    )
    assert (done.returncode, done.stdout) == (130, "tidied up\n")
    assert done.stderr == "vnav: interrupted; what was finished is kept\n"


def test_who_interrupts_once_more_after_a_while_waits_no_longer(tmp_path: Path) -> None:
    done = interrupted(
        tmp_path,
        """
        import time
        try:
            interrupt()
        finally:
            time.sleep(0.3)
            interrupt()
            time.sleep(60)
        """,
    )
    assert (done.returncode, done.stdout) == (130, "")
    assert done.stderr == "vnav: interrupted; what was finished is kept\n"


def test_an_interruption_of_compiled_code_is_no_bug(tmp_path: Path) -> None:
    done = interrupted(tmp_path, "raise SystemError('of a dispatcher') from KeyboardInterrupt()")
    assert done.returncode == 130
    assert done.stderr == "vnav: interrupted; what was finished is kept\n"


def test_a_background_job_is_not_interrupted(tmp_path: Path) -> None:
    """A shell starts it with the signal ignored."""
    code = """
import signal
signal.signal(signal.SIGINT, signal.SIG_IGN)
from vnav import __main__
__main__._interrupt_once()
print(signal.getsignal(signal.SIGINT) is signal.SIG_IGN)
"""
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=tmp_path, text=True, capture_output=True)
    assert done.stdout == "True\n"
