"""A map beside the old one takes its place, or does not; the old one is whole at every moment."""

import shutil
from pathlib import Path

import pytest

from vnav.errors import MapError, VnavError
from vnav.io.store.map_folder import MapFolder, aside
from vnav.io.store.replacement import replacing


@pytest.fixture
def folder(tmp_path: Path) -> MapFolder:
    """A map of one stage, beside which nothing else lies."""
    (tmp_path / "place").mkdir()
    folder = MapFolder.create(tmp_path / "place" / "map")
    write(folder, "old")
    return folder


def write(folder: MapFolder, text: str) -> None:
    with folder.writing("odometry", {}, {}) as draft:
        (draft / "result.txt").write_text(text)


def broken_off(folder: MapFolder, error: BaseException) -> None:
    """A replacement that ends with an error when its one stage is written."""
    with replacing(folder) as draft:
        write(draft, "new")
        raise error


def replaced(folder: MapFolder) -> None:
    with replacing(folder) as draft:
        write(draft, "new")


def content(folder: MapFolder) -> str:
    return (MapFolder.open(folder.root).stage("odometry") / "result.txt").read_text()


def beside(folder: MapFolder) -> list[str]:
    return sorted(path.name for path in folder.root.resolve().parent.iterdir())


def test_the_new_map_takes_the_place_when_it_is_finished(folder: MapFolder) -> None:
    with replacing(folder) as draft:
        write(draft, "new")
        assert content(folder) == "old"
    assert content(folder) == "new"
    assert beside(folder) == ["map"]


def test_a_refusal_leaves_the_old_map_and_nothing_else(folder: MapFolder) -> None:
    with pytest.raises(VnavError, match="refused"):
        broken_off(folder, VnavError("refused"))
    assert content(folder) == "old"
    assert beside(folder) == ["map"]


def test_what_an_interruption_leaves_is_there_again_the_next_time(folder: MapFolder) -> None:
    with pytest.raises(KeyboardInterrupt):
        broken_off(folder, KeyboardInterrupt())
    assert content(folder) == "old"
    with replacing(folder) as draft:
        assert content(draft) == "new"
    assert content(folder) == "new"


def test_a_draft_that_is_no_map_is_made_anew(folder: MapFolder) -> None:
    # A kill while it was being deleted: some of its files are gone.
    with pytest.raises(KeyboardInterrupt):
        broken_off(folder, KeyboardInterrupt())
    (folder.root.parent / ".map.draft" / "map.json").unlink()
    with replacing(folder) as draft:
        assert not draft.has("odometry")
        write(draft, "newer")
    assert content(folder) == "newer"


@pytest.mark.parametrize("open_map", [MapFolder.open, MapFolder.create])
def test_a_map_whose_replacement_was_killed_between_two_renames_is_brought_back(
    folder: MapFolder, open_map: object
) -> None:
    folder.root.rename(aside(folder.root))
    assert callable(open_map)
    open_map(folder.root)
    assert content(folder) == "old"
    assert beside(folder) == ["map"]


def test_files_that_are_not_of_the_map_stay_in_its_folder(folder: MapFolder) -> None:
    (folder.root / "notes.txt").write_text("mine")
    (folder.root / "photos").mkdir()
    (folder.root / "photos" / "goal.jpg").write_text("mine, too")
    (folder.root / "reports").mkdir()
    with replacing(folder) as draft:
        write(draft, "new")
    assert (folder.root / "notes.txt").read_text() == "mine"
    assert (folder.root / "photos" / "goal.jpg").read_text() == "mine, too"
    assert not (folder.root / "reports").exists()  # those of the new map


def test_a_link_to_a_map_stays_a_link(folder: MapFolder, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(folder.root)
    linked = MapFolder(tmp_path / "link")
    with replacing(linked) as draft:
        write(draft, "new")
    assert (tmp_path / "link").is_symlink()
    assert content(folder) == content(linked) == "new"


def test_a_folder_beside_which_nothing_can_be_written_is_named(
    folder: MapFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "mkdir", refuse)
    with pytest.raises(MapError, match="expected to write a map at .*draft.*Permission denied"):
        broken_off(folder, KeyboardInterrupt())
    monkeypatch.undo()
    assert content(folder) == "old"


def test_a_map_that_cannot_be_moved_stays_and_the_finished_one_is_named(
    folder: MapFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A mount point, for instance.
    move = Path.rename

    def refuse(path: Path, target: Path) -> Path:
        if path.name == "map":
            raise OSError(16, "Device or resource busy")
        return move(path, target)

    monkeypatch.setattr(Path, "rename", refuse)
    with pytest.raises(MapError, match=r"Device or resource busy; it is finished in .*draft"):
        replaced(folder)
    assert content(folder) == "old"
    monkeypatch.undo()
    replaced(folder)
    assert content(folder) == "new"


def test_a_map_that_is_not_there_is_not_brought_back_from_nothing(folder: MapFolder) -> None:
    shutil.rmtree(folder.root)
    with pytest.raises(MapError, match="expected a map at"):
        MapFolder.open(folder.root)
