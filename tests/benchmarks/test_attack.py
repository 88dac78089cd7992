"""The attack finds nothing in a sample of it, and does find what is planted."""

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

pytestmark = pytest.mark.slow

PLANTED = """
import ctypes
import sys
import time
from vnav.errors import MapError

def raises():
    raise KeyError("a bug")

def hangs():
    time.sleep(60)

def crashes():
    ctypes.string_at(0)

def takes_all_memory():
    return len(bytearray(2**40))

def tells_two_lines():
    print("vnav: this is wrong\\nand that", file=sys.stderr)
    return 1

def tells_nothing():
    return 1

def leaks():
    print("[ WARN:0@1.5] a library speaks", file=sys.stderr)
    return 0

def refuses():
    print("vnav: expected something else", file=sys.stderr)
    return 1
"""
SAMPLE = 150
QUICK = ("maps", "readers", "captures", "photos", "settings", "arguments")
SECONDS = 5.0  # until a planted hang is one


@pytest.fixture(scope="module")
def attacking(script: Callable[[str], ModuleType]) -> ModuleType:
    return script("attack")


@pytest.fixture(scope="module")
def ground(
    attacking: ModuleType,
    tmp_path_factory: pytest.TempPathFactory,
    tiny_capture: Path,
    whole_map: Path,
) -> Any:
    return attacking.made(tmp_path_factory.mktemp("attack") / "ground", tiny_capture, whole_map)


@pytest.fixture(scope="module")
def attack(attacking: ModuleType, ground: Any) -> Iterator[Any]:
    running = attacking.Attack(ground, 0, seconds=120, memory_gb=8)
    yield running
    running.close()


@pytest.fixture(scope="module")
def hasty(attacking: ModuleType, ground: Any, importable: Path) -> Iterator[Any]:
    """An attack that waits for nobody, on commands of this module."""
    (importable / "planted.py").write_text(PLANTED, "utf-8")
    running = attacking.Attack(ground, 0, seconds=SECONDS, memory_gb=8)
    yield running
    running.close()


def came_to(attack: Any, attacking: ModuleType, folder: Path, **of_attempt: Any) -> str:
    attack.ground.lay_out(folder)
    attempt = attacking.Attempt("planted", **of_attempt)
    return str(attack.tried("planted", 1, attempt, folder).came_to)


def test_a_sample_of_the_attack_finds_no_fault(attacking: ModuleType, attack: Any) -> None:
    before = attack.ground.digest()
    cases = list(attacking.numbers(SAMPLE, QUICK))
    outcomes = attacking.all_outcomes(attack, cases, jobs=2)
    assert [o for o in outcomes if o.came_to.startswith("fault")] == []
    assert {"refused", "same"} <= {o.came_to for o in outcomes}
    assert attack.ground.digest() == before


@pytest.mark.parametrize(
    ("function", "fault"),
    [
        ("raises", "traceback: KeyError: 'a bug'"),
        ("hangs", "a hang: more than 5 s"),
        ("crashes", "a crash: SIGSEGV"),
        ("takes_all_memory", "traceback: MemoryError"),
        ("tells_two_lines", "refused, and not in one line"),
        ("tells_nothing", "refused, and not in one line"),
        ("leaks", "noise of a library"),
    ],
)
def test_a_planted_fault_is_seen(
    attacking: ModuleType, hasty: Any, tmp_path: Path, function: str, fault: str
) -> None:
    import planted

    call = getattr(planted, function), ()
    assert came_to(hasty, attacking, tmp_path / "x", call=call).startswith(f"fault: {fault}")


def test_a_worker_that_died_is_followed_by_another(
    attacking: ModuleType, hasty: Any, tmp_path: Path
) -> None:
    import planted

    came_to(hasty, attacking, tmp_path / "x", call=(planted.crashes, ()))
    assert came_to(hasty, attacking, tmp_path / "y", call=(planted.refuses, ())) == "refused"


def test_an_answer_that_differs_in_silence_is_a_fault(
    attacking: ModuleType, attack: Any, tmp_path: Path
) -> None:
    other = {"command": ("config", "fast"), "reference": ("config",)}
    found = came_to(attack, attacking, tmp_path / "x", **other)
    assert found == "fault: another answer in silence, exit 0"


def test_a_file_that_differs_in_silence_is_a_fault(
    attacking: ModuleType, attack: Any, tmp_path: Path
) -> None:
    export = ("export", "map", "--out", "out", "--grid", "pgm")
    assert came_to(attack, attacking, tmp_path / "x", command=export) == "same"
    other = {"command": (*export, "--trajectory", "tum"), "reference": export}
    assert came_to(attack, attacking, tmp_path / "y", **other).startswith("fault: another answer")


def test_what_had_to_be_refused_and_was_not_is_a_fault(
    attacking: ModuleType, attack: Any, tmp_path: Path
) -> None:
    from attacks.attempt import refused

    found = came_to(attack, attacking, tmp_path / "x", command=("config",), judge=refused)
    assert found == "fault: answered what had to be refused"


def test_the_same_case_is_drawn_again(attacking: ModuleType, attack: Any) -> None:
    first, second = (attack.run("readers", 3) for _ in range(2))
    assert (first.what, first.came_to) == (second.what, second.came_to)


def test_a_disturbance_reaches_the_command_as_a_shell_starts_it(
    attacking: ModuleType, attack: Any, tmp_path: Path
) -> None:
    full = attacking.Disturbance(streams={"stdout": "/dev/full"})
    found = came_to(attack, attacking, tmp_path / "x", command=("config",), disturbance=full)
    assert found == "refused"


def test_the_ground_is_told_from_one_that_a_case_wrote_to(
    attacking: ModuleType, ground: Any, tmp_path: Path
) -> None:
    shutil.copytree(ground.root, tmp_path / "copy", ignore=shutil.ignore_patterns("*-*"))
    copy = attacking.Ground(tmp_path / "copy")
    before = copy.digest()
    copy.lay_out(tmp_path / "laid")
    linked = tmp_path / "laid" / "photos" / "camera.toml"
    assert os.stat(linked).st_nlink > 1
    linked.write_text("written in place", "utf-8")
    assert copy.digest() != before
