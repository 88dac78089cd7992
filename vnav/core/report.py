"""What a stage tells when it is done, and a task that has no result."""

from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True)
class Report:
    """Counts and quality of a finished stage; ``reused`` where nothing had to be done.

    ``lines`` are for people, the rest for programs. ``seconds`` and ``cpu_seconds``, summed over
    all threads, are the only place for times.
    """

    stage: str
    values: dict[str, Any]
    lines: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    reused: bool = field(default=False)

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return asdict(self)


@dataclass(frozen=True)
class Failed:
    """A task without a result: ``reason`` in one line; ``traceback`` where it is a bug.

    ``notes``: what the error proposes, such as a file to save.
    """

    reason: str
    traceback: str = ""
    notes: tuple[str, ...] = ()
