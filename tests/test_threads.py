"""OpenMP and BLAS read the number of threads when they are loaded: each run is a new process."""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import pytest

from vnav.threads import AHEAD, Behind, SharedLimit, made_ahead

TRAIN = """
import hashlib
import numpy as np
from vnav import vocabulary
from vnav.config import VocabularyConfig
from vnav.features.sift import SPACE
descriptors = np.random.default_rng(0).integers(0, 80, (2000, 128)).astype(np.uint8)
tree = vocabulary.train(descriptors, SPACE, VocabularyConfig(), 0)
print(hashlib.sha256(tree.centres.tobytes() + tree.level.tobytes()).hexdigest())
"""


def test_the_vocabulary_does_not_depend_on_the_number_of_threads() -> None:
    found = set()
    for threads in ("1", "8"):
        done = subprocess.run(
            [sys.executable, "-P", "-c", TRAIN],
            env=os.environ | {"OMP_NUM_THREADS": threads, "OPENBLAS_NUM_THREADS": threads},
            text=True,
            capture_output=True,
            check=True,
        )
        found.add(done.stdout)
    assert len(found) == 1


def limited(taken: list[str], loaded: list[str]) -> SharedLimit:
    """A limit of whatever is loaded; ``taken`` lists what is limited at the moment."""

    def take() -> Callable[[], None] | None:
        new = [name for name in loaded if name not in taken]
        taken.extend(new)

        def undo() -> None:
            taken[:] = [name for name in taken if name not in new]

        return undo if new else None

    return SharedLimit(take)


def test_a_limit_holds_until_the_last_of_several_calls_has_ended() -> None:
    taken: list[str] = []
    limit = limited(taken, ["blas"])
    first, second = threading.Event(), threading.Event()

    @limit
    def call(may_end: threading.Event) -> None:
        assert may_end.wait(10)

    with ThreadPoolExecutor(2) as pool:
        calls = [pool.submit(call, event) for event in (first, second)]
        while limit.users < 2:
            time.sleep(0.001)
        first.set()
        calls[0].result()
        assert taken == ["blas"]
        second.set()
    assert taken == []


def test_a_library_that_is_loaded_meanwhile_is_limited_by_the_next_call() -> None:
    taken, loaded = list[str](), ["numpy"]
    limit = limited(taken, loaded)
    with limit:
        loaded.append("opencv")
        with limit:
            assert taken == ["numpy", "opencv"]
        assert taken == ["numpy", "opencv"]
    assert taken == []


def test_a_limit_ends_with_an_error() -> None:
    taken: list[str] = []
    with pytest.raises(ValueError, match="mine"), limited(taken, ["blas"]):
        raise ValueError("mine")
    assert taken == []


NOTEBOOK = """
import numpy as np
from threadpoolctl import threadpool_info
import vnav.threads

def blas():
    return {d["num_threads"] for d in threadpool_info() if d["user_api"] == "blas"}

before = blas()
with vnav.threads.one_blas_thread:
    assert blas() == {1}, blas()
assert blas() == before, (before, blas())
print(before)
"""


def printed_with_four_threads(program: str) -> str:
    """By a Python of its own, which environment variables let have so many."""
    environment = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")}
    done = subprocess.run(
        [sys.executable, "-P", "-c", program],
        env=environment | {"OPENBLAS_NUM_THREADS": "4"},
        text=True,
        capture_output=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_blas_is_limited_where_numpy_was_loaded_before() -> None:
    """As in a notebook, where no environment variable can reach it any more."""
    assert printed_with_four_threads(NOTEBOOK) == f"{{{min(4, os.cpu_count() or 1)}}}"


LATER = """
import sys
import vnav.threads

limit = vnav.threads.one_blas_thread
with limit:
    assert "numpy" not in sys.modules
import numpy as np
from threadpoolctl import threadpool_info

for _ in range(2):
    with limit:
        assert [d["num_threads"] for d in threadpool_info() if d["user_api"] == "blas"] == [1]
    (after,) = [d["num_threads"] for d in threadpool_info() if d["user_api"] == "blas"]
print(after)
"""


def test_blas_that_is_loaded_after_a_first_limit_is_limited_by_the_next() -> None:
    assert printed_with_four_threads(LATER) == str(min(4, os.cpu_count() or 1))


def test_items_come_in_order_and_the_next_is_made_while_one_is_used() -> None:
    used = threading.Event()

    def make(k: int) -> int:
        assert k == 0 or used.wait(10)
        return -k

    found = []
    for item in made_ahead(make, range(6)):
        found.append(item)
        used.set()
    assert found == [0, -1, -2, -3, -4, -5]


def test_as_many_items_are_made_at_once_as_are_made_ahead() -> None:
    together = threading.Barrier(AHEAD, timeout=10)
    assert len(list(made_ahead(lambda _: together.wait(), range(2 * AHEAD)))) == 2 * AHEAD


def test_no_more_than_a_few_items_are_made_ahead() -> None:
    made: list[int] = []
    for item in made_ahead(lambda k: made.append(k) or k, range(9)):
        time.sleep(0.01)
        assert max(made) <= item + AHEAD


def test_an_error_while_an_item_is_made_is_raised_where_it_is_used() -> None:
    with pytest.raises(ZeroDivisionError):
        list(made_ahead(lambda k: 1 // k, (1, 0)))


def test_work_behind_is_done_in_order_and_before_the_wait_ends() -> None:
    behind, done = Behind(), list[int]()

    def work() -> None:
        time.sleep(0.01)
        done.append(len(done))

    for _ in range(3):
        behind.start(work)
    behind.wait()
    assert done == [0, 1, 2]


def test_what_work_behind_raises_is_raised_once_and_where_it_is_waited_for() -> None:
    def work() -> None:
        raise ValueError("mine")

    behind = Behind()
    behind.start(work)
    with pytest.raises(ValueError, match="mine"):
        behind.wait()
    behind.wait()
