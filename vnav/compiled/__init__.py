"""Loops that numba compiles: once for each user, then they come from the cache."""

import logging
from collections.abc import Callable
from typing import Any, TypeVar

import numba
from numba.core import event

from vnav.caches import code_cache

log = logging.getLogger(__name__)
Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """The function as machine code that runs beside others; a division by zero gives inf or NaN."""
    kept = code_cache()
    elsewhere, numba.config.CACHE_DIR = numba.config.CACHE_DIR, str(kept or "")
    try:
        machine_code: Function = numba.njit(
            function, cache=kept is not None, nogil=True, error_model="numpy"
        )
    finally:
        numba.config.CACHE_DIR = elsewhere
    return machine_code


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
