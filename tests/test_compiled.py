"""Machine code: when numba is loaded, what it says, where its code is kept."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from vnav.caches import code_cache
from vnav.compiled import compiled, descriptors

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


def run(program: str, folder: Path, cache: Path) -> "subprocess.CompletedProcess[str]":
    """A program in a folder, whose machine code is kept in the cache."""
    return subprocess.run(
        [sys.executable, "-B", "-c", program],
        cwd=folder,
        env=os.environ | {"NUMBA_CACHE_DIR": str(cache)},
        text=True,
        capture_output=True,
        check=True,
        timeout=120,
    )


def test_compiling_is_announced_once_and_not_again_from_the_cache(tmp_path: Path) -> None:
    (tmp_path / "loops.py").write_text(LOOPS)
    said = [run(PROGRAM, tmp_path, tmp_path / "cache").stderr for _ in range(2)]
    assert said[0].count("compiling, once") == 1
    assert said[1] == ""


def test_numba_is_loaded_by_the_first_call(tmp_path: Path) -> None:
    (tmp_path / "loops.py").write_text(LOOPS)
    program = (
        "import sys, loops; print('numba' in sys.modules, loops.twice(2), 'numba' in sys.modules)"
    )
    assert run(program, tmp_path, tmp_path / "cache").stdout.split() == ["False", "4", "True"]


AT_ONCE = """
from concurrent.futures import ThreadPoolExecutor
import loops
from vnav.compiled import load_compiler

with ThreadPoolExecutor(3) as pool:
    pool.submit(load_compiler)
    print(*pool.map(lambda f: f(2), [loops.twice, loops.half, loops.twice, loops.half]))
"""


def test_first_calls_by_several_threads_wait_for_one_another(tmp_path: Path) -> None:
    (tmp_path / "loops.py").write_text(LOOPS)
    assert run(AT_ONCE, tmp_path, tmp_path / "cache").stdout.split() == ["4", "1.0", "4", "1.0"]


COLORAMA = """
__version__ = "9.9"
def init(): raise AssertionError("sys.stdout is swapped")
reinit = deinit = init
class Fore: BLUE = CYAN = GREEN = MAGENTA = RED = RESET = WHITE = YELLOW = BLACK = ""
class Style: BRIGHT = DIM = RESET_ALL = NORMAL = ""
"""


def test_compiling_leaves_the_streams_alone(tmp_path: Path) -> None:
    (tmp_path / "colorama.py").write_text(COLORAMA)
    program = "from vnav.compiled import self_test; self_test()"
    command = [sys.executable, "-c", program]
    subprocess.run(command, cwd=tmp_path, check=True)  # found before the installed colorama


OUTER = """
from vnav.compiled import compiled
from inner import STEP, rise

@compiled
def climbed(x):
    return higher(x) + STEP

@compiled
def higher(x):
    return rise(x)

print(climbed(1))
"""
INNER = """
from vnav.compiled import compiled
from deep import height

STEP = {step}

@compiled
def rise(x):
    return x + height()
"""
DEEP = """
from vnav.compiled import compiled

@compiled
def height():
    return {height}
"""


def test_machine_code_is_not_older_than_what_is_in_it_from_other_files(tmp_path: Path) -> None:
    """The file itself stays as it is: numba would look at no other."""
    (tmp_path / "outer.py").write_text(OUTER)
    printed = []
    for step, height in ((10, 100), (20, 100), (20, 300), (20, 300)):
        (tmp_path / "inner.py").write_text(INNER.format(step=step))
        (tmp_path / "deep.py").write_text(DEEP.format(height=height))
        printed.append(run("import outer", tmp_path, tmp_path / "cache").stdout.strip())
    assert printed == ["111", "121", "321", "321"]


NEAR = """
import numpy as np
from vnav.compiled import compiled
from vnav.compiled.descriptors import squared_distance

@compiled
def near(a, b):
    return squared_distance(a, b)

print(near(np.zeros(2, np.uint8), np.ones(2, np.uint8)))
"""
WITH_DESCRIPTORS = """
import sys
from importlib.util import module_from_spec, spec_from_file_location

spec = spec_from_file_location("vnav.compiled.descriptors", "descriptors.py")
sys.modules[spec.name] = module_from_spec(spec)
spec.loader.exec_module(sys.modules[spec.name])
import near
"""


def test_machine_code_is_not_older_than_the_distances_of_descriptors_in_it(tmp_path: Path) -> None:
    """They are chosen by type, under a name that is no compiled function itself."""
    (tmp_path / "near.py").write_text(NEAR)
    source = Path(descriptors.__file__).read_text()
    printed = []
    for total in ("int(total)", "int(total) + 5"):
        (tmp_path / "descriptors.py").write_text(source.replace("int(total)", total))
        printed.append(run(WITH_DESCRIPTORS, tmp_path, tmp_path / "cache").stdout.strip())
    assert printed == ["2", "7"]


def test_copies_of_a_file_share_their_machine_code(tmp_path: Path) -> None:
    said = []
    for copy in ("checkout", "installed"):
        (tmp_path / copy).mkdir()
        (tmp_path / copy / "loops.py").write_text(LOOPS)
        said.append(run(PROGRAM, tmp_path / copy, tmp_path / "cache").stderr)
    assert "compiling, once" in said[0]
    assert said[1] == ""


def test_a_division_by_zero_is_infinite_not_an_error() -> None:
    @compiled
    def inverse(x: float) -> float:
        return 1 / x

    assert inverse(0.0) == np.inf


@pytest.fixture
def folder(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], Path | None]]:
    """The folder that would be chosen, asked anew."""
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    code_cache.cache_clear()
    yield code_cache.__wrapped__
    code_cache.cache_clear()


def test_machine_code_is_kept_in_the_users_code_cache(
    folder: Callable[[], Path | None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert folder() == tmp_path / "cache" / "vnav" / "compiled"


def test_without_a_home_it_is_kept_in_a_temporary_folder_of_the_user_alone(
    folder: Callable[[], Path | None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "/proc/nowhere")
    monkeypatch.setattr(tempfile, "gettempdir", lambda: str(tmp_path))
    found = folder()
    assert found == tmp_path / f"vnav-{os.getuid()}"
    assert found.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("mode", [0o777, 0o720])
def test_a_folder_that_others_can_write_is_not_used(
    mode: int,
    folder: Callable[[], Path | None],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What lies in it is run."""
    monkeypatch.setenv("XDG_CACHE_HOME", "/proc/nowhere")
    monkeypatch.setattr(tempfile, "gettempdir", lambda: str(tmp_path))
    planted = tmp_path / f"vnav-{os.getuid()}"
    planted.mkdir()
    planted.chmod(mode)
    assert folder() is None


def test_a_link_that_somebody_planted_is_not_followed(
    folder: Callable[[], Path | None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "/proc/nowhere")
    monkeypatch.setattr(tempfile, "gettempdir", lambda: str(tmp_path))
    (tmp_path / "his").mkdir()
    (tmp_path / f"vnav-{os.getuid()}").symlink_to(tmp_path / "his")
    assert folder() is None


def test_code_runs_where_nothing_can_be_kept(tmp_path: Path) -> None:
    (tmp_path / "loops.py").write_text(LOOPS)
    program = (
        "from vnav import caches; caches._is_own = lambda folder: False\n"
        "import loops; print(loops.twice(2))"
    )
    environment = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=tmp_path,
        env=environment,
        text=True,
        capture_output=True,
        check=True,
    )
    assert done.stdout == "4\n"
    assert not list(tmp_path.rglob("*.nbi"))


def test_an_argument_with_a_default_is_refused() -> None:
    def scaled(x: float, factor: float = 2.0) -> float:
        return factor * x

    with pytest.raises(TypeError, match="expected no defaults of arguments.*scaled"):
        compiled(scaled)
