"""Tasks in this process, in processes and on a cluster: whatever happens, each has one result."""

import errno
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from vnav import batch
from vnav.batch import cluster as cluster_module
from vnav.core.report import Failed
from vnav.errors import ConfigError

# In a module of its own, which other processes can import by its name.
WORK = r'''
import os, signal, time
from dataclasses import dataclass
from pathlib import Path

from vnav.errors import VnavError

@dataclass(frozen=True)
class Task:
    name: str
    folder: Path

def shout(task, progress):
    """The name in capitals; the name may ask for something else."""
    progress("step", 1, 2)
    what, _, _ = task.name.partition(" ")
    with (task.folder / "tries").open("a") as file:
        file.write(what + "\n")
    if what == "refused":
        raise VnavError("expected better, found worse")
    if what == "greedy":
        raise MemoryError
    if what == "bug":
        return 1 / 0
    if what == "killed" or what == "once" and not (task.folder / "killed").exists():
        (task.folder / "killed").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if what == "waits":
        (task.folder / f"{os.getpid()}.at_work").touch()
        while not (task.folder / "go").exists():
            time.sleep(0.02)
    return task.name.upper()
'''


@pytest.fixture(scope="module")
def work(importable: Path) -> ModuleType:
    (importable / "shouting.py").write_text(WORK)
    import shouting  # type: ignore[import-not-found]

    return shouting


def results(
    work: ModuleType, names: Sequence[str], folder: Path, **how: Any
) -> dict[str, str | Failed]:
    tasks = [work.Task(name, folder) for name in names]
    found = list(batch.run(work.shout, tasks, **how))
    assert sorted(k for k, _ in found) == list(range(len(tasks)))
    return {names[k]: result for k, result in found}


def appeared(folder: Path, pattern: str, count: int) -> list[Path]:
    """Files of a name, waited for."""
    deadline = time.monotonic() + 120
    while len(files := list(folder.glob(pattern))) < count:
        assert time.monotonic() < deadline, f"no {pattern}"
        time.sleep(0.02)
    return files


@pytest.mark.parametrize("how", [{}, {"jobs": 1}, {"jobs": 3}])
def test_every_task_has_its_result_and_an_error_is_one(
    work: ModuleType, tmp_path: Path, how: dict[str, int]
) -> None:
    found = results(work, ["a", "refused", "b"], tmp_path, **how)
    refusal = Failed("expected better, found worse")
    assert found == {"a": "A", "refused": refusal, "b": "B"}


def test_no_tasks_are_no_results(work: ModuleType) -> None:
    assert list(batch.run(work.shout, [], jobs=2)) == []


def test_steps_are_told_with_the_name_of_the_task(work: ModuleType, tmp_path: Path) -> None:
    for how in ({}, {"jobs": 2}):
        told: list[tuple[str, int, int]] = []
        steps = lambda *step, told=told: told.append(step)  # noqa: E731
        results(work, ["a", "b"], tmp_path, progress=steps, **how)
        assert sorted(told) == [("a: step", 1, 2), ("b: step", 1, 2)]


def test_a_process_that_is_killed_is_followed_by_another(work: ModuleType, tmp_path: Path) -> None:
    found = results(work, ["a", "once", "b"], tmp_path, jobs=2)
    assert found == {"a": "A", "once": "ONCE", "b": "B"}
    assert (tmp_path / "tries").read_text().split().count("once") == 2


def test_a_task_that_kills_its_process_again_and_again_fails_alone(
    work: ModuleType, tmp_path: Path
) -> None:
    found = results(work, ["killed", "a"], tmp_path, jobs=1)
    assert found["a"] == "A"
    assert isinstance(failed := found["killed"], Failed)
    assert "ended 3 times, last by SIGKILL" in failed.reason
    assert (tmp_path / "tries").read_text().split() == ["killed"] * 3 + ["a"]


def test_a_bug_is_a_failure_with_its_traceback_and_looks_like_one_in_this_process(
    work: ModuleType, tmp_path: Path
) -> None:
    failed = results(work, ["bug"], tmp_path, jobs=1)["bug"]
    assert isinstance(failed, Failed)
    assert failed.reason == "a bug: ZeroDivisionError: division by zero"
    assert "in shout" in failed.traceback
    with pytest.raises(ZeroDivisionError):
        results(work, ["bug"], tmp_path)


def test_a_task_without_memory_fails_in_one_line(work: ModuleType, tmp_path: Path) -> None:
    short = Failed("expected memory for it, found none left; run fewer at once")
    for how in ({}, {"jobs": 1}):
        assert results(work, ["greedy", "a"], tmp_path, **how) == {"greedy": short, "a": "A"}


def test_a_process_that_cannot_be_started_is_a_failure(
    work: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_arguments: Any, **_options: Any) -> None:
        raise OSError(errno.ENOMEM, os.strerror(errno.ENOMEM))

    monkeypatch.setattr(subprocess, "Popen", refuse)
    failed = Failed("expected to start a process for it, found: Cannot allocate memory")
    assert results(work, ["a"], tmp_path, jobs=1) == {"a": failed}


def test_who_wants_no_more_results_waits_for_none(work: ModuleType, tmp_path: Path) -> None:
    tasks = [work.Task(name, tmp_path) for name in ("a", "waits for ever", "b")]
    found = batch.run(work.shout, tasks, jobs=2)
    next(found)
    (at_work,) = appeared(tmp_path, "*.at_work", 1)
    found.close()  # type: ignore[attr-defined]
    gone(int(at_work.stem))


def test_processes_and_their_files_end_with_the_one_that_started_them(
    work: ModuleType, tmp_path: Path
) -> None:
    parent, child = _waiting(tmp_path)
    (scratch,) = tmp_path.glob("vnav-*")
    parent.kill()
    parent.wait()
    gone(child)
    assert not scratch.exists()


def test_files_of_processes_that_were_all_killed_are_cleared_by_the_next_run(
    work: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    parent, child = _waiting(tmp_path)
    (scratch,) = tmp_path.glob("vnav-*")
    os.utime(scratch, (0, 0))
    assert results(work, ["a"], tmp_path, jobs=1) == {"a": "A"}
    assert scratch.exists()  # of processes that live
    os.kill(child, signal.SIGSTOP)  # it cannot clear up itself
    while _is_running(child):
        time.sleep(0.01)
    parent.kill()
    parent.wait()
    os.kill(child, signal.SIGKILL)
    gone(child)
    assert scratch.exists()
    os.utime(scratch, (0, 0))
    assert results(work, ["a"], tmp_path, jobs=1) == {"a": "A"}
    assert not list(tmp_path.glob("vnav-*"))


def _is_running(process: int) -> bool:
    """Whether any thread of a process was not stopped yet."""
    states = Path(f"/proc/{process}/task").glob("*/stat")
    return any(path.read_text().rpartition(")")[2].split()[0] != "T" for path in states)


def _waiting(folder: Path) -> tuple[subprocess.Popen[bytes], int]:
    """A process that runs a task in another, its temporary files in a folder; that one's number."""
    code = (
        "import pathlib, shouting; from vnav import batch;"
        f"task = shouting.Task('waits for ever', pathlib.Path({str(folder)!r}));"
        "list(batch.run(shouting.shout, [task], jobs=1))"
    )
    environment = os.environ | {"TMPDIR": str(folder)}
    parent = subprocess.Popen([sys.executable, "-P", "-c", code], env=environment)
    (at_work,) = appeared(folder, "*.at_work", 1)
    return parent, int(at_work.stem)


def gone(pid: int) -> None:
    """Waits for a process to end."""
    deadline = time.monotonic() + 10
    while Path(f"/proc/{pid}").exists() and "State:\tZ" not in _status(pid):
        assert time.monotonic() < deadline, f"{pid} lives on"
        time.sleep(0.02)


def _status(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return "State:\tZ"


def test_a_worker_of_a_cluster_is_killed_and_nothing_is_lost(
    work: ModuleType, cluster: Any, tmp_path: Path
) -> None:
    names = ["waits 1", "waits 2", "refused", "bug", "a", "b"]
    in_processes = results(work, names[2:], tmp_path, jobs=2)
    tasks = [work.Task(name, tmp_path) for name in names]
    found = batch.run(work.shout, tasks, scheduler=cluster.scheduler_address)
    first = kill_one_when_both_work(cluster, tmp_path, found)
    got = {names[k]: result for k, result in [first, *found]}
    assert {name: got[name] for name in names[:2]} == {"waits 1": "WAITS 1", "waits 2": "WAITS 2"}
    assert {name: got[name] for name in names[2:]} == in_processes
    tries = (tmp_path / "tries").read_text().split()
    assert tries.count("waits") == 3


def kill_one_when_both_work(cluster: Any, folder: Path, found: Iterator[Any]) -> Any:
    """Kills a worker in the middle of a task, then lets the tasks go on; the first result."""
    from threading import Thread

    def kill() -> None:
        try:
            appeared(folder, "*.at_work", 2)
            os.kill(cluster.workers[0].pid, signal.SIGKILL)
        finally:
            (folder / "go").touch()

    killer = Thread(target=kill)
    killer.start()
    first = next(found)
    killer.join()
    return first


def test_a_scheduler_that_is_not_there_is_told(
    work: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster_module, "PATIENCE_S", 0.5)
    with pytest.raises(ConfigError, match=r"scheduler with workers at tcp://127\.0\.0\.1:1, found"):
        results(work, ["a"], tmp_path, scheduler="tcp://127.0.0.1:1")


def test_workers_of_another_version_are_refused(
    work: ModuleType, cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster_module, "__version__", "99")
    with pytest.raises(ConfigError, match="expected vnav 99 on every worker, found 0"):
        results(work, ["a"], tmp_path, scheduler=cluster.scheduler_address)
