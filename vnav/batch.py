"""Many independent tasks over one seam: in this process, in processes, or on a Dask cluster.

A task is a plain value with a name; a function that its module names makes a result of it. Whatever
happens to a task, it has one result: errors are values here.
"""

import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
import uuid
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Protocol, TypeVar

from vnav import __version__
from vnav.core.progress import Progress, silent
from vnav.core.report import Failed
from vnav.errors import ConfigError, VnavError

ATTEMPTS = 3  # of a task whose process is killed
TOLD_S = 0.2  # between two steps that a process tells of
PATIENCE_S = 60.0  # for a scheduler, and for its first worker
CHILD = "from vnav.batch import child; child()"


class Named(Protocol):
    """What every task has: a name for people."""

    @property
    def name(self) -> str:
        """Tells it from the others."""


TaskT = TypeVar("TaskT", bound=Named, contravariant=True)
ResultT = TypeVar("ResultT", covariant=True)


class Function(Protocol[TaskT, ResultT]):
    """A function at the top of a module; tasks and results can be pickled."""

    def __call__(self, task: TaskT, progress: Progress) -> ResultT:
        """The task's result; VnavError where there is none."""


@dataclass(frozen=True)
class Step:
    """How far a task in another process is."""

    task: str
    done: int
    total: int


def run(
    function: Function[TaskT, ResultT],
    tasks: Sequence[TaskT],
    *,
    jobs: int = 0,
    scheduler: str = "",
    progress: Progress = silent,
) -> Iterator[tuple[int, ResultT | Failed]]:
    """Each task's number with its result, or why it has none, as they are finished.

    ``jobs``: how many run at once, each in a process of its own; 0: one after the other in this
    one. ``scheduler``: address of a Dask cluster, whose workers start such processes instead. A
    task whose process, or worker, is killed is tried again, ATTEMPTS times in all. In this process
    an error that is no VnavError ends everything. ConfigError where the cluster cannot be used.
    """
    if scheduler:
        yield from _on_cluster(function, tasks, scheduler)
    elif jobs:
        yield from _in_processes(function, tasks, jobs, progress)
    else:
        for k, task in enumerate(tasks):
            yield k, _outcome(function, task, _labelled(progress, task))


def _in_processes(
    function: Function[TaskT, ResultT], tasks: Sequence[TaskT], jobs: int, progress: Progress
) -> Iterator[tuple[int, ResultT | Failed]]:
    children = Children()
    with ThreadPoolExecutor(jobs) as pool:
        try:
            numbers = {
                pool.submit(children.run, function, task, _labelled(progress, task)): k
                for k, task in enumerate(tasks)
            }
            for future in as_completed(numbers):
                yield numbers[future], future.result()
        finally:  # also where the caller wants no more
            pool.shutdown(wait=False, cancel_futures=True)
            children.kill()


class Children:
    """Runs tasks, each in a process of its own: may be called from several threads."""

    def __init__(self) -> None:
        self._alive: set[subprocess.Popen[bytes]] = set()
        self._killed = False

    def run(
        self, function: Function[TaskT, ResultT], task: TaskT, progress: Progress
    ) -> ResultT | Failed:
        """The result of a task; a process that is killed is followed by another."""
        for _ in range(ATTEMPTS):
            result = self._attempt(function, task, progress)
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
        with tempfile.TemporaryDirectory(prefix="vnav-") as scratch, ours:
            said = Path(scratch) / "said"
            command = [sys.executable, "-P", "-c", CHILD, str(theirs.fileno())]
            environment = os.environ | {"TMPDIR": scratch, "OPENBLAS_NUM_THREADS": "1"}
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
    connection = Connection(int(sys.argv[1]))
    function, task = connection.recv()
    threading.Thread(target=_end_with, args=[connection], daemon=True).start()
    told = 0.0

    def tell(task: str, done: int, total: int) -> None:
        nonlocal told
        if done >= total or time.monotonic() - told > TOLD_S:
            told = time.monotonic()
            connection.send(Step(task, done, total))

    connection.send(_outcome(function, task, tell))


def _end_with(parent: Connection) -> None:
    """A parent says nothing more: what comes is its end."""
    try:
        parent.recv()
    except (EOFError, ConnectionError):
        os._exit(1)


def _outcome(
    function: Function[TaskT, ResultT], task: TaskT, progress: Progress
) -> ResultT | Failed:
    try:
        return function(task, progress)
    except VnavError as error:
        return Failed(str(error))


def _bug(said: str) -> Failed:
    """A process that ended without a result and without a signal: an unknown exception."""
    lines = said.strip().splitlines() or ["it said nothing"]
    return Failed(f"a bug: {lines[-1]}", said)


def _labelled(progress: Progress, task: Named) -> Progress:
    name = task.name
    return lambda step, done, total: progress(f"{name}: {step}", done, total)


def attempt(function: Function[TaskT, ResultT], task: TaskT) -> ResultT | Failed:
    """What a worker of a cluster does: the task in a process of its own."""
    return Children().run(function, task, silent)


def _on_cluster(
    function: Function[TaskT, ResultT], tasks: Sequence[TaskT], scheduler: str
) -> Iterator[tuple[int, ResultT | Failed]]:
    with _client(scheduler) as client:
        from distributed import as_completed as as_finished

        batch = uuid.uuid4().hex
        numbers = {
            client.submit(attempt, function, task, key=f"{task.name}-{batch}-{k}"): k
            for k, task in enumerate(tasks)
        }
        for future in as_finished(numbers):
            result = _result_of(future)
            future.release()  # a worker that is killed later need not do it again
            yield numbers[future], result


def _result_of(future: Any) -> Any:
    """A Dask future's result; a worker that is killed again and again is the task's failure."""
    if future.status == "finished":
        return future.result()
    if future.status == "error":
        return Failed(str(future.exception()))
    return Failed(f"the cluster has {future.status} it; run it again")


def _client(scheduler: str) -> Any:
    """A client of the cluster whose workers have this version of vnav."""
    try:
        from distributed import Client
    except ImportError as error:
        raise ConfigError(
            "expected Dask for --scheduler, found none; install it with pip install 'vnav[cluster]'"
        ) from error
    try:
        client = Client(scheduler, timeout=PATIENCE_S)
        client.wait_for_workers(1, timeout=PATIENCE_S)
    except (OSError, ValueError) as error:  # a timeout is an OSError, too
        raise ConfigError(
            f"expected a Dask scheduler with workers at {scheduler}, found: {error}"
        ) from error
    for worker, version in client.run(_version, on_error="return").items():
        if version != __version__:
            client.close()
            raise ConfigError(
                f"expected vnav {__version__} on every worker, found {version} on {worker};"
                " install the same version there"
            )
    return client


def _version() -> str:
    return __version__
