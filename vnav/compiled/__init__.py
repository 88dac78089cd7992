"""Loops that numba compiles: once for each user, then they come from the cache."""

import hashlib
import logging
import os
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

# To colour its errors numba swaps sys.stdout while it compiles, in whatever thread that is.
os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")

import numba
from numba.core import event
from numba.core.dispatcher import Dispatcher

from vnav.caches import code_cache

log = logging.getLogger(__name__)
Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """The function as machine code that runs beside others; a division by zero gives inf or NaN.

    numba looks whether the function's own file has changed. What it takes from other files becomes
    machine code of its own, so the folder is named by that.
    """
    kept = code_cache()
    folder = "" if kept is None else str(kept / _foreign(function.__module__))
    elsewhere, numba.config.CACHE_DIR = numba.config.CACHE_DIR, folder
    try:
        machine_code: Function = numba.njit(
            function, cache=kept is not None, nogil=True, error_model="numpy"
        )
    finally:
        numba.config.CACHE_DIR = elsewhere
    return machine_code


@cache
def _foreign(module: str) -> str:
    """A hash of what a module's compiled functions have from others: their files, and constants.

    Both stand above the module's first compiled function.
    """
    values = vars(sys.modules[module])
    constants = {name: v for name, v in values.items() if isinstance(v, bool | int | float | tuple)}
    others = {v.py_func.__module__ for v in values.values() if isinstance(v, Dispatcher)}
    told = [repr(sorted(constants.items()))]
    for other in sorted(others - {module}):
        file = Path(sys.modules[other].__file__ or "").stat()
        told.append(f"{other} {file.st_size} {file.st_mtime_ns} {_foreign(other)}")
    return hashlib.sha256("\n".join(told).encode()).hexdigest()[:16]


def self_test() -> None:
    """Compile something and run it; an exception where that does not work."""
    if compiled(_doubled)(21) != 42:
        raise ArithmeticError("expected 42 of compiled code, found another number")


def _doubled(number: int) -> int:
    return 2 * number


class _Notice(event.Listener):  # type: ignore[misc]
    """Says once a process that it waits for the compiler."""

    def __init__(self) -> None:
        self._said = False

    def on_start(self, _event: event.Event) -> None:
        """A function is not in the cache."""
        if not self._said:
            self._said = True
            log.info("compiling, once: the next run starts without this")

    def on_end(self, _event: event.Event) -> None:
        """A function is compiled."""


event.register("numba:compile", _Notice())
