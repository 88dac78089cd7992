"""Processes that run attempts one after the other, and are replaced when one ends them."""

import faulthandler
import multiprocessing
import os
import resource
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import cv2

from attacks.attempt import Result

Call = tuple[Callable[..., int], tuple[Any, ...]]


class Worker:
    """One process at a time, with a limit on its memory and on the seconds of a call."""

    def __init__(self, memory_bytes: int, seconds: float) -> None:
        self._memory, self._seconds = memory_bytes, seconds
        self._said = tempfile.TemporaryDirectory(prefix="attack-")
        self._process: Any = None
        self._connection: Any = None

    def run(self, call: Call, folder: Path) -> Result:
        """What a call in a folder came to."""
        if self._process is None:
            self._start()
        self._connection.send((*call, folder))
        code, ended = 0, ""
        try:
            if self._connection.poll(self._seconds):
                code = self._connection.recv()
            else:
                ended = f"a hang: more than {self._seconds:g} s"
                self.close()
        except (EOFError, ConnectionError):
            self._process.join()
            ended = f"a crash: {name_of(self._process.exitcode)}"
            self.close()
        return Result(code, self._text("out"), self._text("err"), ended)

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.join()
            self._connection.close()
            self._process = None

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        arguments = theirs, self._memory, Path(self._said.name)
        self._process = context.Process(target=serve, args=arguments, daemon=True)
        self._process.start()
        theirs.close()
        if self._connection.recv() != "ready":
            raise RuntimeError("expected a worker that is ready")

    def _text(self, name: str) -> str:
        path = Path(self._said.name) / name
        return path.read_text("utf-8", "replace") if path.exists() else ""


def name_of(code: int | None) -> str:
    """How a process ended."""
    return signal.Signals(-code).name if code is not None and code < 0 else f"exit {code}"


def serve(connection: Connection, memory_bytes: int, said: Path) -> None:
    """What the process does: each call it is sent, until nobody sends any."""
    resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, resource.RLIM_INFINITY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the driver's affair
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)  # as main does
    connection.send("ready")
    try:
        while True:
            function, arguments, folder = connection.recv()
            connection.send(called(function, arguments, folder, said))
    except (EOFError, ConnectionError):
        os._exit(0)


def called(function: Callable[..., int], arguments: Any, folder: Path, said: Path) -> int:
    """The exit code of a call whose output goes to files; a traceback is output."""
    os.chdir(folder)
    for number, name in ((1, "out"), (2, "err")):
        file = os.open(said / name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        os.dup2(file, number)
        os.close(file)
    faulthandler.enable(sys.stderr)
    try:
        code = function(*arguments)
    except BaseException:
        traceback.print_exc()
        code = 1
    sys.stdout.flush()
    sys.stderr.flush()
    return code


def vnav(*arguments: str) -> int:
    """A command line of vnav in this process."""
    from vnav.cli.main import main

    sys.argv = ["vnav", *arguments]
    return main()
