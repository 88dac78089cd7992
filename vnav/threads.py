"""Limits of the threads that native libraries use, what vnav's own have, and work ahead of its use.

The sums of BLAS, and the clusters of k-means, depend on the number of threads; vnav spreads frames
over cores instead. Environment variables come too late where numpy is loaded already.
"""

import os
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ContextDecorator
from functools import lru_cache
from threading import Lock, local
from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

Item = TypeVar("Item")
Made = TypeVar("Made")
Undo = Callable[[], None]
AHEAD = 2  # items that are made while one is used


class PerThread(Generic[Made]):
    """What threads cannot share: each has one of its own, which is made when it first asks."""

    def __init__(self, make: Callable[[], Made]) -> None:
        self._make = make
        self._own = local()

    def __call__(self) -> Made:
        """Make it, or return what this thread made before."""
        if not hasattr(self._own, "made"):
            self._own.made = self._make()
        made: Made = self._own.made
        return made


def made_ahead(make: Callable[[Item], Made], items: Iterable[Item]) -> Iterator[Made]:
    """What is made of each item, in order: a few are made by other threads while one is used."""
    with ThreadPoolExecutor(AHEAD) as makers:
        coming: deque[Future[Made]] = deque()
        for item in items:
            coming.append(makers.submit(make, item))
            if len(coming) > AHEAD:
                yield coming.popleft().result()
        while coming:
            yield coming.popleft().result()


class Behind:
    """Work that a thread of its own does, while its owner goes on to where that is needed.

    What the work changes is the thread's from `start` to `wait`.
    """

    def __init__(self) -> None:
        self._thread = ThreadPoolExecutor(1)
        self._work: Future[None] | None = None

    def start(self, work: Callable[[], None]) -> None:
        """Begin, when the work before is done."""
        self.wait()
        self._work = self._thread.submit(work)

    def wait(self) -> None:
        """Until the work is done; raises what it raised."""
        work, self._work = self._work, None
        if work is not None:
            work.result()


def openmp_free_pool() -> ThreadPoolExecutor:
    """A thread a core, in which OpenMP has no others: its limit is each thread's own."""
    return ThreadPoolExecutor(os.cpu_count(), initializer=_one_native_thread, initargs=("openmp",))


class SharedLimit(ContextDecorator):
    """One thread while at least one block, or decorated function, is at work in any thread.

    ``take`` sets the limit and returns what undoes it, None where nothing had to be set. Every
    block that begins asks it again, for it reaches only libraries that are loaded; the last block
    to end undoes all.
    """

    def __init__(self, take: Callable[[], Undo | None]) -> None:
        self._take = take
        self._lock = Lock()
        self.users = 0
        self._undo: list[Undo] = []

    def __enter__(self) -> None:
        with self._lock:
            undo = self._take()
            if undo is not None:
                self._undo.append(undo)
            self.users += 1

    def __exit__(self, *_error: object) -> None:
        with self._lock:
            self.users -= 1
            while not self.users and self._undo:
                self._undo.pop()()


@lru_cache(maxsize=2)
def _libraries(user_api: str, _modules: int) -> "ThreadpoolController":
    """Those that are loaded; they come with modules, and are looked for where these are others."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController().select(user_api=user_api)


def _one_native_thread(user_api: str) -> Undo | None:
    loaded = _libraries(user_api, len(sys.modules))
    if all(library["num_threads"] == 1 for library in loaded.info()):
        return None
    undo: Undo = loaded.limit(limits=1).restore_original_limits
    return undo


def _one_opencv_thread() -> Undo | None:
    import cv2

    threads = cv2.getNumThreads()
    if threads == 1:
        return None
    cv2.setNumThreads(1)
    return lambda: cv2.setNumThreads(threads)


one_blas_thread = SharedLimit(lambda: _one_native_thread("blas"))
one_opencv_thread = SharedLimit(_one_opencv_thread)
