"""Commands that run until somebody interrupts them, in a process of their own."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def running(*arguments: object, **environment: str) -> Iterator[subprocess.Popen[str]]:
    """A command line of vnav that goes on, with variables of the environment besides."""
    with subprocess.Popen(
        [sys.executable, "-P", "-m", "vnav", *map(str, arguments)],
        env=os.environ | environment,
        cwd="/",
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        preexec_fn=_interruptible,
    ) as process:
        yield process


def stopped(process: subprocess.Popen[str]) -> tuple[str, str]:
    """What a command still prints on stdout and on stderr after Ctrl-C."""
    process.send_signal(signal.SIGINT)
    rest, said = process.communicate(timeout=60)
    return rest, said


def _interruptible() -> None:
    """What a shell starts in the background is not, nor what that starts; no more than a minute."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.alarm(60)
