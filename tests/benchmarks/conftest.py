"""Scripts of benchmarks/ as modules."""

from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from tests.scripts import loaded

FOLDER = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture(scope="session")
def script() -> Iterator[Callable[[str], ModuleType]]:
    """Imports a script by its name; scripts import each other."""

    def load(name: str) -> ModuleType:
        return loaded(FOLDER / f"{name}.py")

    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(FOLDER)
        yield load


@pytest.fixture(scope="session")
def missed(script: Callable[[str], ModuleType]) -> Callable[..., Any]:
    """Of measurements those that are not what is wanted."""
    found: Callable[..., Any] = script("recording").missed
    return found
