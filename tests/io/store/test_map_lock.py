import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from vnav.errors import MapError
from vnav.io.store.map_lock import only_writer

HOLD = """
import sys
from pathlib import Path
from vnav.io.store.map_lock import only_writer
with only_writer(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return tmp_path / "map"


@pytest.fixture
def other(root: Path) -> Iterator[subprocess.Popen[str]]:
    """A process that writes the map."""
    command = [sys.executable, "-c", HOLD, str(root)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout
        assert process.stdout.readline() == "held\n"
        yield process
        process.kill()


def test_the_second_writer_is_told_who_the_first_is(
    root: Path, other: subprocess.Popen[str]
) -> None:
    who = rf"process {other.pid} on .* \(-c .*map\) writes it; wait"
    with pytest.raises(MapError, match=who), only_writer(root):
        pass
    assert (root / ".lock").exists()


def test_another_thread_is_another_writer(root: Path) -> None:
    second = only_writer(root)
    with only_writer(root), pytest.raises(MapError, match="the only one who writes"):
        second.__enter__()


def test_a_killed_writer_holds_nothing(root: Path, other: subprocess.Popen[str]) -> None:
    other.kill()
    other.wait()
    with only_writer(root):
        assert f'"process": {other.pid}' not in (root / ".lock").read_text()


def test_a_writer_leaves_no_trace(root: Path) -> None:
    with only_writer(root):
        (root / "map.json").touch()
    assert [path.name for path in root.iterdir()] == ["map.json"]


def test_a_folder_in_which_nothing_was_written_is_not_left_behind(root: Path) -> None:
    with only_writer(root):
        pass
    assert not root.exists()


def test_the_lock_follows_a_folder_that_is_renamed(root: Path) -> None:
    draft = root.with_name("draft")
    root.mkdir()
    with only_writer(root), only_writer(draft):
        root.rename(root.with_name("old"))
        draft.rename(root)
        with pytest.raises(MapError, match="the only one"), only_writer(root):
            pass
    assert not list(root.parent.glob("*/.lock"))


def test_a_place_where_nothing_can_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for root in (tmp_path / "file", tmp_path / "file" / "map"):
        unusable = rf"write a map at {root}, found: .*ot a directory"
        with pytest.raises(MapError, match=unusable), only_writer(root):
            pass
