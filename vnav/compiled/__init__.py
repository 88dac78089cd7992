"""Loops that numba compiles: once an installation, then they come from its cache."""

import logging
from collections.abc import Callable
from typing import Any, TypeVar

import numba
from numba.core import event

log = logging.getLogger(__name__)
Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """The function as machine code that runs beside others; a division by zero gives inf or NaN."""
    machine_code: Function = numba.njit(function, cache=True, nogil=True, error_model="numpy")
    return machine_code


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
