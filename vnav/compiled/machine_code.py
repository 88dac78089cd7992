"""Machine code by numba, kept in a folder of the user's; to import this module takes 0.2 s."""

import hashlib
import logging
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

# To colour its errors numba swaps sys.stdout while it compiles, in whatever thread that is.
os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")

import numba
import numpy as np
from numba import types
from numba.core import event
from numba.core.caching import UserProvidedCacheLocator
from numba.extending import overload, typeof_impl
from numba.np import linalg

from vnav.caches import code_cache
from vnav.compiled import Compiled
from vnav.compiled.descriptors import by_type, of_bytes, squared_distance

log = logging.getLogger(__name__)


def machine_code(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function as numba runs it.

    It is kept in a folder named by what it is made of, so every copy of this code shares it.
    """
    kept = code_cache()
    with _numba_keeps_in(kept and kept / _made_of(function.__module__)):
        made: Callable[..., Any] = numba.njit(
            function, cache=kept is not None, nogil=True, error_model="numpy"
        )
    return made


def load() -> None:
    """Load numba's library, as the first call of machine code does.

    But for scipy.linalg, a fifth of a second: numba looks whether it is there, and needs it for
    products of matrices only, which load it when they run.
    """
    looks, linalg.ensure_blas = linalg.ensure_blas, lambda: None
    try:
        import_module("numba.np.arraymath")
    finally:
        linalg.ensure_blas = looks
    of_bytes(np.zeros(1, np.uint8), np.zeros(1, np.uint8))


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
    """A hash of a module's file, its constants, and the modules its functions take others from."""
    values = vars(sys.modules[module])
    constants = {name: v for name, v in values.items() if isinstance(v, bool | int | float | tuple)}
    others = {
        v.__module__ for v in values.values() if isinstance(v, Compiled) or v is squared_distance
    }
    told = [repr(sorted(constants.items())), *map(_made_of, sorted(others - {module}))]
    source = Path(sys.modules[module].__file__ or "").read_bytes()
    return hashlib.sha256(source + "\n".join(told).encode()).hexdigest()[:16]


@typeof_impl.register(Compiled)  # type: ignore[untyped-decorator]
def _called_by_another(function: Compiled, _context: Any) -> types.Dispatcher:
    """Compiled functions call each other's machine code."""
    return types.Dispatcher(function.machine_code)


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


overload(squared_distance)(by_type)
event.register("numba:compile", _Notice())
