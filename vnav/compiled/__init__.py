"""Loops that numba compiles: once for each user, then they come from the cache."""

from collections.abc import Callable
from functools import update_wrapper
from threading import RLock
from typing import Any, TypeVar, cast

Function = TypeVar("Function", bound=Callable[..., Any])

_one_by_one = RLock()


def compiled(function: Function) -> Function:
    """The function as machine code that runs beside others; a division by zero gives inf or NaN.

    Its first call loads numba: a third of a second that a command without it does not take.
    TypeError where an argument has a default: each call that leaves one out takes 0.1 ms.
    """
    if function.__defaults__:
        raise TypeError(
            f"expected no defaults of arguments, which machine code takes 0.1 ms a call to fill in,"
            f" found some of {function.__qualname__}; let who calls it name them"
        )
    return cast("Function", Compiled(function))


class Compiled:
    """A function in whose place its machine code is run."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function
        self._made: Callable[..., Any] | None = None
        update_wrapper(self, function)

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Run it."""
        return (self._made or self.machine_code)(*arguments, **named)

    @property
    def machine_code(self) -> Callable[..., Any]:
        """Made, or read from the cache, where it is called for the first time."""
        with _one_by_one:
            if self._made is None:
                from vnav.compiled.machine_code import machine_code

                self._made = machine_code(self.function)
            return self._made


def load_compiler() -> None:
    """What the first call of anything compiled does, ahead of it."""
    with _one_by_one:
        from vnav.compiled.machine_code import load

        load()


def self_test() -> None:
    """Compile something and run it; an exception where that does not work."""
    if compiled(_doubled)(21) != 42:
        raise ArithmeticError("expected 42 of compiled code, found another number")


def _doubled(number: int) -> int:
    return 2 * number
