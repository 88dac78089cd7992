"""A map that root made is asked by a user who has no home and can write nothing of it."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from vnav.caches import code_cache

NOBODY = 54321  # no user of this number is known to the system, so none has a home

# That user may read all files: Python itself may lie in root's home. What he writes is refused.
READS = "-all,+dac_read_search"
BECOMES = (
    *("setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups"),
    *(f"--inh-caps={READS}", f"--ambient-caps={READS}", f"--bounding-set={READS}"),
)


def _can_become() -> bool:
    if os.geteuid() != 0 or shutil.which("setpriv") is None:
        return False
    return subprocess.run([*BECOMES, "true"], capture_output=True).returncode == 0


pytestmark = pytest.mark.skipif(
    not _can_become(), reason="only root can be another user, by setpriv"
)


@pytest.fixture(scope="module")
def shared(whole_map: Path, tiny_capture: Path) -> Iterator[Path]:
    """A folder with a map and photos of root's, and room for what NOBODY compiles."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o755)
        shutil.copytree(whole_map, folder / "map")
        shutil.copytree(tiny_capture / "photos", folder / "photos")
        cache = folder / "tmp" / f"vnav-{NOBODY}"
        if compiled := code_cache():  # or it would take a minute
            shutil.copytree(compiled, cache / "compiled")
        cache.mkdir(parents=True, exist_ok=True)
        for path in (cache.parent, cache, *cache.rglob("*")):
            os.chown(path, NOBODY, NOBODY)
            path.chmod(0o700)
        yield folder


def _as_nobody(shared: Path, *command: str) -> subprocess.CompletedProcess[str]:
    """What a command in the shared folder says to NOBODY."""
    kept = {name: value for name, value in os.environ.items() if name in ("PATH", "LANG")}
    return subprocess.run(
        [*BECOMES, sys.executable, "-P", "-m", *command],
        cwd=shared,
        env=kept | {"TMPDIR": str(shared / "tmp")},
        text=True,
        capture_output=True,
    )


def test_a_map_of_roots_is_located_in_by_a_user_without_a_home(shared: Path) -> None:
    before = sorted((shared / "map").rglob("*"))
    done = _as_nobody(shared, "vnav", "locate", "photos/000.jpg", "--map", "map", "--json")
    assert (done.returncode, json.loads(done.stdout)["located"]) == (0, True)
    assert "Traceback" not in done.stderr
    assert "the pose could not be remembered in map: Permission denied" in done.stderr
    assert sorted((shared / "map").rglob("*")) == before


def test_a_map_of_roots_is_not_written_by_another_user_and_that_is_one_line(shared: Path) -> None:
    done = _as_nobody(shared, "vnav", "index", "--map", "map")
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "expected to write a map at map, found: Permission denied" in done.stderr
