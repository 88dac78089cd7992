"""Tasks in processes of their own: one that is killed is followed by another."""

import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any

from vnav.batch.scratch import clear_abandoned, scratch
from vnav.batch.task import Function, ResultT, TaskT
from vnav.core.progress import Progress
from vnav.core.report import Failed
from vnav.errors import VnavError, notes_of
from vnav.memory import keep_freed

ATTEMPTS = 3  # of a task whose process is killed
TOLD_S = 0.2  # between two steps that a process tells of
CHILD = "from vnav.batch.children import child; child()"


@dataclass(frozen=True)
class Step:
    """How far a task in another process is."""

    task: str
    done: int
    total: int


class Children:
    """Runs tasks, each in a process of its own: may be called from several threads."""

    def __init__(self) -> None:
        self._alive: set[subprocess.Popen[bytes]] = set()
        self._killed = False
        with suppress(OSError):  # no temporary folder: each task will say so
            clear_abandoned()

    def run(
        self, function: Function[TaskT, ResultT], task: TaskT, progress: Progress
    ) -> ResultT | Failed:
        """The result of a task; a process that is killed is followed by another."""
        for _ in range(ATTEMPTS):
            try:
                result = self._attempt(function, task, progress)
            except OSError as error:  # no memory or no room on the disk
                return Failed(f"expected to start a process for it, found: {error.strerror}")
            if not isinstance(result, signal.Signals) or self._killed:
                break
        if not isinstance(result, signal.Signals):
            return result
        return Failed(
            f"its process was ended {ATTEMPTS} times, last by {result.name}; where memory ran out"
            " (SIGKILL), run fewer at once"
        )

    def kill(self) -> None:
        """End all processes; their tasks fail."""
        self._killed = True
        for process in tuple(self._alive):
            process.kill()

    def _attempt(
        self, function: Function[TaskT, ResultT], task: TaskT, progress: Progress
    ) -> ResultT | Failed | signal.Signals:
        """The result, or the signal that ended the process; temporary files go with it."""
        ours, theirs = Pipe()
        with scratch() as folder, ours:
            said = folder / "said"
            command = [sys.executable, "-P", "-c", CHILD, str(theirs.fileno())]
            environment = os.environ | {"TMPDIR": str(folder)}
            with said.open("wb") as file:
                process = subprocess.Popen(
                    command,
                    pass_fds=[theirs.fileno()],
                    env=environment,
                    stdin=subprocess.DEVNULL,
                    stdout=file,
                    stderr=file,
                )
            theirs.close()
            self._alive.add(process)
            if self._killed:  # while it was started
                process.kill()
            found: list[ResultT | Failed] = _received(ours, (function, task), progress)
            code = process.wait()
            self._alive.discard(process)
            if found:
                return found[0]
            return signal.Signals(-code) if code < 0 else _bug(said.read_text("utf-8", "replace"))


def _received(connection: Connection, question: Any, progress: Progress) -> list[Any]:
    """What the process answers, told of its steps meanwhile; empty where it ends before."""
    try:
        connection.send(question)
        while isinstance(message := connection.recv(), Step):
            progress(message.task, message.done, message.total)
    except (EOFError, ConnectionError):
        return []
    return [message]


def child() -> None:
    """What a process does: receive a function and a task, send the result; end with its parent."""
    keep_freed()
    connection = Connection(int(sys.argv[1]))
    function, task = connection.recv()
    threading.Thread(target=_end_with, args=[connection], daemon=True).start()
    told = 0.0

    def tell(task: str, done: int, total: int) -> None:
        nonlocal told
        if done >= total or time.monotonic() - told > TOLD_S:
            told = time.monotonic()
            connection.send(Step(task, done, total))

    connection.send(outcome(function, task, tell))


def _end_with(parent: Connection) -> None:
    """A parent says nothing more: what comes is its end, and it cleans up no more."""
    try:
        parent.recv()
    except (EOFError, ConnectionError):
        shutil.rmtree(os.environ["TMPDIR"], ignore_errors=True)
        os._exit(1)


def outcome(
    function: Function[TaskT, ResultT], task: TaskT, progress: Progress
) -> ResultT | Failed:
    """The function's result, or the VnavError that it ended with; so for want of memory."""
    try:
        return function(task, progress)
    except VnavError as error:
        return Failed(str(error), notes=notes_of(error))
    except MemoryError:
        return Failed("expected memory for it, found none left; run fewer at once")


def _bug(said: str) -> Failed:
    """A process that ended without a result and without a signal: an unknown exception."""
    lines = said.strip().splitlines() or ["it said nothing"]
    return Failed(f"a bug: {lines[-1]}", said)
