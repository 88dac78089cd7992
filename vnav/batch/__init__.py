"""Many independent tasks over one seam: in this process, in processes, or on a Dask cluster.

A task is a plain value with a name; a function that its module names makes a result of it. Whatever
happens to a task, it has one result: errors are values here.
"""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed

from vnav.batch.children import Children, outcome
from vnav.batch.cluster import on_cluster
from vnav.batch.task import Function, Named, ResultT, TaskT
from vnav.core.progress import Progress, silent
from vnav.core.report import Failed


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
        yield from on_cluster(function, tasks, scheduler)
    elif jobs:
        yield from _in_processes(function, tasks, jobs, progress)
    else:
        for k, task in enumerate(tasks):
            yield k, outcome(function, task, _labelled(progress, task))


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


def _labelled(progress: Progress, task: Named) -> Progress:
    name = task.name
    return lambda step, done, total: progress(f"{name}: {step}", done, total)
