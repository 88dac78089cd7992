"""What a task is, and what makes a result of it."""

from typing import Protocol, TypeVar

from vnav.core.progress import Progress


class Named(Protocol):
    """What every task has: a name for people."""

    @property
    def name(self) -> str:
        """Tells it from the others."""


TaskT = TypeVar("TaskT", bound=Named, contravariant=True)
ResultT = TypeVar("ResultT", covariant=True)


class Function(Protocol[TaskT, ResultT]):
    """A function at the top of a module; tasks and results can be pickled."""

    def __call__(self, task: TaskT, progress: Progress) -> ResultT:
        """The task's result; VnavError where there is none."""
