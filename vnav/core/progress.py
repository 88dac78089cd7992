"""How long work tells how far it is."""

from typing import Protocol


class Progress(Protocol):
    """Called as often as the work likes; whoever listens decides what to show."""

    def __call__(self, task: str, done: int, total: int) -> None:
        """``done`` of ``total`` units of ``task`` are finished."""


def silent(task: str, done: int, total: int) -> None:
    """Show nothing."""
