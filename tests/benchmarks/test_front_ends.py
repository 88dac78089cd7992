import subprocess
import sys
from collections.abc import Callable
from types import ModuleType

import pytest

from vnav.config import load


@pytest.fixture(scope="module")
def front_ends(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("front_ends")


def test_every_way_is_one_that_settings_can_name(front_ends: ModuleType) -> None:
    for options in front_ends.WAYS.values():
        pairs = dict(zip(options[::2], options[1::2], strict=True))
        load(pairs.get("--config"), [pairs["--set"]] if "--set" in pairs else [])


def test_the_processor_is_timed_and_not_the_clock(front_ends: ModuleType) -> None:
    asleep = [sys.executable, "-S", "-c", "import time; time.sleep(1)"]
    assert front_ends.cpu_seconds(asleep) < 1


def test_a_command_that_fails_is_no_time(front_ends: ModuleType) -> None:
    with pytest.raises(subprocess.CalledProcessError):
        front_ends.cpu_seconds([sys.executable, "-S", "-c", "raise SystemExit(3)"])


def test_sizes_are_held_against_those_of_sift(front_ends: ModuleType) -> None:
    wanted = {"orb": 0.85}
    assert front_ends.ratio("house", "orb", "index", 0.8, wanted).wanted == "at most 0.85"
    assert front_ends.ratio("house", "orb", "index", 0.8, wanted).peer == "sift"
    assert front_ends.ratio("house", "sift", "index", 1.0, wanted).peer is None
