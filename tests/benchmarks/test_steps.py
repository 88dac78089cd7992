from collections.abc import Callable
from types import ModuleType

import pytest

SITE = "/opt/lib/python3.11/site-packages"


@pytest.fixture(scope="module")
def steps(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("steps")


def test_what_a_library_does_counts_for_the_module_that_calls_it(steps: ModuleType) -> None:
    files = [f"{SITE}/numpy/linalg.py", "/home/me/vnav/registration/judge.py", "/home/me/vnav/a.py"]
    assert steps.step_of(files) == "registration/judge"


def test_a_checkout_may_lie_in_a_folder_of_that_name(steps: ModuleType) -> None:
    assert steps.step_of(["/home/vnav/main/build/vnav/core/se3.py"]) == "core/se3"


def test_loading_and_work_of_nobodys_are_steps_too(steps: ModuleType) -> None:
    loading = ["<frozen importlib._bootstrap>", "/home/me/vnav/io/files.py"]
    assert steps.step_of(loading) == steps.LOADING
    assert steps.step_of([f"{SITE}/numba/core/ir.py", ""]) == steps.OTHERS


def test_times_of_all_threads_are_added_up(steps: ModuleType) -> None:
    frames = [{"file": "/x/vnav/a.py"}, {"file": "/x/vnav/b.py"}, {"file": None}]
    threads = [
        {"samples": [[0, 2], [0, 1]], "weights": [0.01, 0.02]},
        {"samples": [[0]], "weights": [0.04]},
    ]
    found = steps.by_step({"shared": {"frames": frames}, "profiles": threads})
    assert found == pytest.approx({"a": 0.05, "b": 0.02})


def test_a_thread_that_waits_takes_no_time(steps: ModuleType) -> None:
    frames = [{"file": "/x/vnav/a.py"}, {"file": "/lib/concurrent/futures/thread.py"}]
    threads = [{"samples": [[0, 1], [1, 0], [1]], "weights": [0.1, 0.02, 0.4]}]
    found = steps.by_step({"shared": {"frames": frames}, "profiles": threads})
    assert found == pytest.approx({"a": 0.02})


def test_steps_that_take_little_are_told_together(steps: ModuleType) -> None:
    seconds = steps.Seconds({"a": 0.9, "b": 0.095, "c": 0.004, steps.OTHERS: 0.001})
    found = {
        m.what: m.value
        for m in steps.measurements("house", 10, {"loops": seconds})
        if m.quantity == "share"
    }
    told = {"loops: all": 100, "loops: a": 90, "loops: b": 9.5, f"loops: {steps.OTHERS}": 0.5}
    assert found == pytest.approx(told)
