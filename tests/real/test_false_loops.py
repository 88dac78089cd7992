"""Wrong loop closures do not survive the optimisation: scattered ones, nor those that agree."""

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytestmark = [pytest.mark.real, pytest.mark.long]

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "false_loops.py"
LIMIT_M = 0.02


def test_false_loops_do_not_bend_the_house(
    house: Any, figures: Callable[[str, str, str], None]
) -> None:
    command = [sys.executable, SCRIPT, house.map, house.capture, "--limit", str(LIMIT_M)]
    done = subprocess.run(command, text=True, capture_output=True)
    (worst_m,) = re.findall(r"worst ATE ([\d.]+) m", done.stdout) or ["none"]
    figures("house with false loops: worst ATE of 10", f"{worst_m} m", f"{LIMIT_M} m")
    assert done.returncode == 0, done.stdout + done.stderr
