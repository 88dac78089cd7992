"""A limit of address space, in which OpenBLAS would wait for memory for ever, is told at once."""

import resource
import subprocess
import sys
from pathlib import Path

import pytest

from vnav.checking.machine import LEAST_BYTES, require_address_space
from vnav.errors import VnavError

SUITE = """
[[sequence]]
name = "{name}"
capture = "{capture}"
"""


def _limited(*command: object) -> subprocess.CompletedProcess[str]:
    """A command of vnav with 1.2 GB of address space: enough to begin, too little for a map."""
    limit = 1_200_000_000
    return subprocess.run(
        [sys.executable, "-P", "-m", "vnav", *map(str, command)],
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (limit, limit)),
        text=True,
        capture_output=True,
        timeout=300,
        check=False,
    )


def test_a_map_is_not_begun_in_too_little_address_space(tiny_capture: Path, tmp_path: Path) -> None:
    done = _limited("build-map", tiny_capture, "--map", tmp_path / "map", "-q")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == (
        "vnav: expected at least 2.5 GB of address space to make a map, found a limit of 1.2 GB;"
        " raise it with 'ulimit -v'\n"
    )


def test_an_evaluation_in_processes_says_so_of_each_run_and_ends(
    tiny_capture: Path, tmp_path: Path
) -> None:
    suite = tmp_path / "suite.toml"
    suite.write_text("".join(SUITE.format(name=n, capture=tiny_capture) for n in ("a", "b")))
    done = _limited("evaluate", suite, "--out", tmp_path / "out", "--jobs", 2, "-q")
    assert done.returncode == 1
    assert done.stdout.count("found a limit of 1.2 GB") == 2
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("limit", [resource.RLIM_INFINITY, LEAST_BYTES])
def test_without_a_limit_or_with_a_high_one_nothing_is_said(
    limit: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda _: (limit, limit))
    require_address_space()


def test_a_low_limit_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda _: (LEAST_BYTES - 1, -1))
    with pytest.raises(VnavError, match=r"expected at least 2\.5 GB .* raise it with 'ulimit -v'"):
        require_address_space()
