import hashlib
import io
import os
import tarfile
from dataclasses import replace
from pathlib import Path

import pytest

from vnav.config import CaptureConfig
from vnav.errors import DatasetError
from vnav.io.datasets.catalogue import PublicSequence, catalogue, named
from vnav.io.datasets.fetched import datasets_folder, fetch, state, verify
from vnav.io.sources.open_capture import open_capture

NAME = "rgbd_dataset_freiburg1_xyz"
PATH = f"/freiburg1/{NAME}.tgz"


@pytest.fixture(scope="module")
def archive(tiny_capture: Path) -> bytes:
    """The rendered room as the benchmark packs its sequences."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w:gz", compresslevel=1) as tar:
        tar.add(tiny_capture, NAME)
    return buffer.getvalue()


@pytest.fixture
def served(file_server, archive: bytes):
    file_server.files[PATH] = archive
    return file_server


@pytest.fixture
def sequence(served) -> PublicSequence:
    return named(catalogue(served.url), [NAME])[0]


def relative_files(folder: Path) -> dict[str, bytes]:
    paths = [path for path in folder.rglob("*") if path.is_file()]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


def names(root: Path) -> set[str]:
    return {path.name for path in root.iterdir()}


def test_a_fetched_sequence_is_the_capture_and_nothing_else_stays(
    sequence: PublicSequence, tiny_capture: Path, tmp_path: Path
) -> None:
    assert fetch(sequence, tmp_path / "new" / "root")
    root = tmp_path / "new" / "root"
    assert relative_files(root / NAME) == relative_files(tiny_capture)
    assert len(open_capture(root / NAME, CaptureConfig())) == 60
    assert names(root) == {NAME, f"{NAME}.json"}
    assert state(sequence, root) == "fetched"


def test_a_download_broken_off_in_the_middle_goes_on(
    served, sequence: PublicSequence, tiny_capture: Path, archive: bytes, tmp_path: Path
) -> None:
    half = len(archive) // 2
    served.breaks_after = [half, 0]
    with pytest.raises(DatasetError, match="run the same command again"):
        fetch(sequence, tmp_path)
    assert state(sequence, tmp_path) == "begun"
    assert fetch(sequence, tmp_path)
    assert relative_files(tmp_path / NAME) == relative_files(tiny_capture)
    assert served.asked[-1] == f"bytes={half}-"


def test_what_is_there_and_whole_is_not_fetched_again(
    served, sequence: PublicSequence, tmp_path: Path
) -> None:
    fetch(sequence, tmp_path)
    assert not fetch(sequence, tmp_path)
    assert len(served.asked) == 1


def test_verify_names_what_is_missing_and_what_is_damaged(
    sequence: PublicSequence, tmp_path: Path
) -> None:
    fetch(sequence, tmp_path)
    folder = tmp_path / NAME
    assert verify(sequence, tmp_path).whole
    first, second, third = sorted((folder / "rgb").iterdir())[:3]
    first.unlink()
    content = bytearray(second.read_bytes())
    content[-3] ^= 1
    second.write_bytes(content)
    third.write_bytes(b"")
    (folder / "note.txt").write_text("mine")
    verdict = verify(sequence, tmp_path)
    assert verdict.missing == [f"rgb/{first.name}"]
    assert verdict.damaged == [f"rgb/{second.name}", f"rgb/{third.name}"]
    assert verdict.files == len(relative_files(folder))  # one is gone, one was added


def test_a_damaged_sequence_is_replaced(sequence: PublicSequence, tmp_path: Path) -> None:
    fetch(sequence, tmp_path)
    (tmp_path / NAME / "rgb.txt").write_text("")
    assert fetch(sequence, tmp_path)
    assert verify(sequence, tmp_path).whole
    assert names(tmp_path) == {NAME, f"{NAME}.json"}


def test_an_archive_that_is_another_than_at_first_is_told_and_not_unpacked(
    served, sequence: PublicSequence, archive: bytes, tmp_path: Path
) -> None:
    fetch(sequence, tmp_path)
    (tmp_path / NAME / "rgb.txt").unlink()
    served.files[PATH] = archive[:-5] + b"other"
    found = hashlib.sha256(served.files[PATH]).hexdigest()
    expected = hashlib.sha256(archive).hexdigest()
    with pytest.raises(DatasetError, match=f"{expected} as recorded in .*found {found}"):
        fetch(sequence, tmp_path)
    assert not (tmp_path / NAME / "rgb.txt").exists()
    assert names(tmp_path) == {NAME, f"{NAME}.json"}


@pytest.mark.parametrize("record", ["{}", "[]", '{"files": 1}', "[" * 10_000, "null"])
def test_a_damaged_record_is_named(sequence: PublicSequence, tmp_path: Path, record: str) -> None:
    fetch(sequence, tmp_path)
    (tmp_path / f"{NAME}.json").write_text(record)
    with pytest.raises(DatasetError, match=rf"expected the record of .*{NAME}\.json, found: "):
        verify(sequence, tmp_path)


def test_a_published_checksum_is_held_against_the_archive(
    sequence: PublicSequence, archive: bytes, tmp_path: Path
) -> None:
    with pytest.raises(DatasetError, match="as published"):
        fetch(replace(sequence, sha256="0" * 64), tmp_path)
    assert names(tmp_path) == set()
    assert fetch(replace(sequence, sha256=hashlib.sha256(archive).hexdigest()), tmp_path)


def test_a_malicious_archive_leaves_nothing(
    served, sequence: PublicSequence, tmp_path: Path
) -> None:
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w:gz") as tar:
        for name in (f"{NAME}/rgb.txt", f"{NAME}/../../escaped"):
            info = tarfile.TarInfo(name)
            info.size = 4
            tar.addfile(info, io.BytesIO(b"evil"))
    served.files[PATH] = buffer.getvalue()
    with pytest.raises(DatasetError, match="escaped', which leads out of it"):
        fetch(sequence, tmp_path / "root")
    assert names(tmp_path) == {"root"}
    assert names(tmp_path / "root") == set()


def test_what_a_killed_run_left_half_is_cleared(
    sequence: PublicSequence, tiny_capture: Path, tmp_path: Path
) -> None:
    (tmp_path / f".{NAME}.draft" / NAME).mkdir(parents=True)
    (tmp_path / f".{NAME}.draft" / NAME / "half.png").touch()
    fetch(sequence, tmp_path)
    assert relative_files(tmp_path / NAME) == relative_files(tiny_capture)
    assert names(tmp_path) == {NAME, f"{NAME}.json"}


def test_a_folder_of_ones_own_is_left_alone(sequence: PublicSequence, tmp_path: Path) -> None:
    (tmp_path / NAME).mkdir()
    with pytest.raises(DatasetError, match="not fetched by vnav"):
        fetch(sequence, tmp_path)
    assert state(sequence, tmp_path) == "own copy"


def test_an_archive_without_a_folder_of_its_own_gets_one(
    served, sequence: PublicSequence, tiny_capture: Path, tmp_path: Path
) -> None:
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w:gz", compresslevel=1) as tar:
        tar.add(tiny_capture, ".")
    served.files[PATH] = buffer.getvalue()
    fetch(sequence, tmp_path)
    assert relative_files(tmp_path / NAME) == relative_files(tiny_capture)
    assert verify(sequence, tmp_path).whole


def test_a_place_where_nothing_can_be_written_is_named(
    sequence: PublicSequence, tmp_path: Path
) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(DatasetError, match="expected to write to .*file.*--to"):
        fetch(sequence, tmp_path / "file" / "root")


def test_the_place_is_the_users_choice_or_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(os.environ, "VNAV_DATASETS", "/data")
    assert datasets_folder() == Path("/data")
    monkeypatch.delitem(os.environ, "VNAV_DATASETS")
    monkeypatch.setitem(os.environ, "XDG_CACHE_HOME", "/cache")
    assert datasets_folder() == Path("/cache/vnav/datasets")
    monkeypatch.delitem(os.environ, "XDG_CACHE_HOME")
    monkeypatch.setitem(os.environ, "HOME", "/home/me")
    assert datasets_folder() == Path("/home/me/.cache/vnav/datasets")
