"""Freed memory is kept for what comes next; each in a process of its own, for it lasts."""

import ctypes
import subprocess
import sys

import pytest

IMAGES, PAGES = 20, 2048  # of 8 MB
WORK = f"""
import resource
import numpy as np
from vnav.memory import keep_freed, return_freed

def faults():
    begin = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range({IMAGES}):
        image, other = np.ones({PAGES} * 4096, np.uint8), np.ones({PAGES} * 4096, np.uint8)
        del image, other
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - begin

def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1])
"""
needs_glibc = pytest.mark.skipif(
    not hasattr(ctypes.CDLL(None), "mallopt"), reason="only glibc is told what to keep"
)


def printed(code: str) -> list[int]:
    done = subprocess.run(
        [sys.executable, "-c", WORK + code], capture_output=True, text=True, check=True
    )
    return [int(word) for word in done.stdout.split()]


@needs_glibc
def test_images_that_come_and_go_take_their_pages_once() -> None:
    (kept,) = printed("keep_freed(); print(faults())")
    assert kept < 3 * PAGES  # two at a time, and what else there is


@needs_glibc
def test_what_is_kept_is_returned_when_asked_for() -> None:
    kept, returned = printed(
        "keep_freed(); faults(); print(resident()); return_freed(); print(resident())"
    )
    assert kept - returned > 1.5 * PAGES
