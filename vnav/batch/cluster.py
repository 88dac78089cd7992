"""Tasks on the workers of a Dask cluster, each in a process of its own there."""

import uuid
from collections.abc import Iterator, Sequence
from typing import Any

from vnav import __version__
from vnav.batch.children import Children
from vnav.batch.task import Function, ResultT, TaskT
from vnav.core.progress import silent
from vnav.core.report import Failed
from vnav.errors import ConfigError

PATIENCE_S = 60.0  # for a scheduler, and for its first worker


def on_cluster(
    function: Function[TaskT, ResultT], tasks: Sequence[TaskT], scheduler: str
) -> Iterator[tuple[int, ResultT | Failed]]:
    """As `vnav.batch.run`; ConfigError where the cluster cannot be used."""
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


def attempt(function: Function[TaskT, ResultT], task: TaskT) -> ResultT | Failed:
    """What a worker of a cluster does: the task in a process of its own."""
    return Children().run(function, task, silent)


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
            "expected Dask for --scheduler, found none; install it with"
            " pip install 'vnav-rgbd[cluster]'"
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
