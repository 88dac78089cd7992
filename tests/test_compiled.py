"""What numba compiles is announced, once, and not where it comes from the cache."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from vnav.compiled import compiled

PROGRAM = """
import logging
logging.basicConfig(level=logging.INFO, format="%(message)s")
import loops
loops.twice(2)
loops.half(2)
"""
LOOPS = """
from vnav.compiled import compiled

@compiled
def twice(x):
    return 2 * x

@compiled
def half(x):
    return x / 2
"""


def test_compiling_is_announced_once_and_not_again_from_the_cache(tmp_path: Path) -> None:
    (tmp_path / "loops.py").write_text(LOOPS)
    said = [
        subprocess.run(
            [sys.executable, "-c", PROGRAM],
            cwd=tmp_path,
            env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")},
            text=True,
            capture_output=True,
            check=True,
        ).stderr
        for _ in range(2)
    ]
    assert said[0].count("compiling, once") == 1
    assert said[1] == ""


def test_a_division_by_zero_is_infinite_not_an_error() -> None:
    @compiled
    def inverse(x: float) -> float:
        return 1 / x

    assert inverse(0.0) == np.inf
