"""Loops that numba compiles: once for each user, then they come from the cache."""

import hashlib
import logging
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

# To colour its errors numba swaps sys.stdout while it compiles, in whatever thread that is.
os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")

import numba
from numba.core import event
from numba.core.caching import UserProvidedCacheLocator
from numba.core.dispatcher import Dispatcher

from vnav.caches import code_cache

log = logging.getLogger(__name__)
Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """The function as machine code that runs beside others; a division by zero gives inf or NaN.

    It is kept in a folder named by what it is made of, so every copy of this code shares it.
    """
    kept = code_cache()
    with _numba_keeps_in(kept and kept / _made_of(function.__module__)):
        machine_code: Function = numba.njit(
            function, cache=kept is not None, nogil=True, error_model="numpy"
        )
    return machine_code


class InOneFolder(UserProvidedCacheLocator):  # type: ignore[misc]
    """Tells numba to keep code in the folder that it is given, wherever the function's file is."""

    @classmethod
    def get_suitable_cache_subpath(cls, py_file: str) -> str:
        """Numba's own puts a hash of the file's folder here."""
        return Path(py_file).stem

    def get_source_stamp(self) -> str:
        """The folder's name says it."""
        return ""


@contextmanager
def _numba_keeps_in(folder: Path | None) -> Iterator[None]:
    """Numba's settings of where code is kept, as they were when the block ends."""
    config = numba.config
    before = config.CACHE_DIR, config.CACHE_LOCATOR_CLASSES
    config.CACHE_DIR = str(folder or "")
    config.CACHE_LOCATOR_CLASSES = f"{InOneFolder.__module__}.{InOneFolder.__name__}"
    try:
        yield
    finally:
        config.CACHE_DIR, config.CACHE_LOCATOR_CLASSES = before


@cache
def _made_of(module: str) -> str:
    """A hash of a module's file, its constants, and the modules its functions take others from.

    Constants and imports stand above the module's first compiled function.
    """
    values = vars(sys.modules[module])
    constants = {name: v for name, v in values.items() if isinstance(v, bool | int | float | tuple)}
    others = {v.py_func.__module__ for v in values.values() if isinstance(v, Dispatcher)}
    told = [repr(sorted(constants.items())), *map(_made_of, sorted(others - {module}))]
    source = Path(sys.modules[module].__file__ or "").read_bytes()
    return hashlib.sha256(source + "\n".join(told).encode()).hexdigest()[:16]


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
