import gzip
import hashlib
import io
import tarfile
from pathlib import Path

import pytest

from vnav.errors import DatasetError
from vnav.io.datasets.unpack import unpack


def member(name: str, kind: bytes = tarfile.REGTYPE, link: str = "") -> tarfile.TarInfo:
    info = tarfile.TarInfo(name)
    info.type, info.linkname = kind, link
    info.size = 4 if kind == tarfile.REGTYPE else 0
    return info


def archive(path: Path, *members: tarfile.TarInfo) -> Path:
    with tarfile.open(path, "w:gz") as tar:
        for info in members:
            tar.addfile(info, io.BytesIO(b"evil") if info.size else None)
    return path


def test_files_come_out_as_they_went_in(tmp_path: Path) -> None:
    tgz = archive(tmp_path / "a.tgz", member("x", tarfile.DIRTYPE), member("x/y/b"), member("c"))
    written = unpack(tgz, tmp_path / "out")
    expected = (4, hashlib.sha256(b"evil").hexdigest())
    assert written == {"x/y/b": expected, "c": expected}
    assert (tmp_path / "out" / "x" / "y" / "b").read_bytes() == b"evil"


@pytest.mark.parametrize(
    "members",
    [
        [member("../escaped")],
        [member("x/../../escaped")],
        [member("/escaped")],
        [member("..\\escaped")],
        [member("C:/escaped")],
        [member("x", tarfile.SYMTYPE, "..")],
        [member("x", tarfile.SYMTYPE, ".."), member("x/escaped")],
        [member("x", tarfile.SYMTYPE, "/etc/passwd")],
        [member("x", tarfile.LNKTYPE, "../escaped")],
        [member("a"), member("x", tarfile.LNKTYPE, "a")],
        [member("x", tarfile.CHRTYPE)],
        [member("x", tarfile.FIFOTYPE)],
    ],
    ids=lambda members: " ".join(f"{m.name}:{m.type.decode()}" for m in members),
)
def test_a_member_that_is_not_a_file_inside_is_refused(
    tmp_path: Path, members: list[tarfile.TarInfo]
) -> None:
    tgz = archive(tmp_path / "a.tgz", *members)
    with pytest.raises(DatasetError, match="do not use this archive"):
        unpack(tgz, tmp_path / "out")
    assert {path.name for path in tmp_path.iterdir()} == {"a.tgz", "out"}
    assert not [path for path in (tmp_path / "out").rglob("*") if path.name != "a"]


def test_an_archive_that_would_fill_the_disk_is_refused(tmp_path: Path) -> None:
    """8 MB of zeros shrink to a thousandth."""
    path = tmp_path / "a.tgz"
    info = tarfile.TarInfo("zeros")
    info.size = 8_000_000
    with tarfile.open(path, "w:gz") as tar:
        tar.addfile(info, io.BytesIO(bytes(info.size)))
    with pytest.raises(DatasetError, match="'zeros', with which it is 100 times as large"):
        unpack(path, tmp_path / "out")
    assert not list((tmp_path / "out").iterdir())


def test_a_file_of_holes_is_refused(tmp_path: Path) -> None:
    """It is as large as its header says, and takes no room in the archive."""
    info = tarfile.TarInfo("holes")
    info.pax_headers = {"GNU.sparse.map": "0,0", "GNU.sparse.size": str(10**15)}
    path = tmp_path / "a.tgz"
    with tarfile.open(path, "w:gz", format=tarfile.PAX_FORMAT) as tar:
        tar.addfile(info)
    with pytest.raises(DatasetError, match="'holes', with which it is"):
        unpack(path, tmp_path / "out")
    assert not list((tmp_path / "out").iterdir())


def test_a_member_that_comes_twice_is_refused(tmp_path: Path) -> None:
    tgz = archive(tmp_path / "a.tgz", member("a"), member("a"))
    with pytest.raises(DatasetError, match="whole .tgz"):
        unpack(tgz, tmp_path / "out")


def test_a_file_that_is_also_a_folder_is_refused(tmp_path: Path) -> None:
    tgz = archive(tmp_path / "a.tgz", member("a"), member("a/b/c"))
    with pytest.raises(DatasetError, match="whole .tgz"):
        unpack(tgz, tmp_path / "out")


@pytest.mark.parametrize("kept", [0, 40, -10, -4])
def test_an_archive_that_is_cut_off_is_refused(tmp_path: Path, kept: int) -> None:
    tgz = archive(tmp_path / "a.tgz", member("a"), member("b"))
    tgz.write_bytes(tgz.read_bytes()[:kept])
    with pytest.raises(DatasetError, match="whole .tgz"):
        unpack(tgz, tmp_path / "out")


def test_an_archive_whose_own_checksum_is_wrong_is_refused(tmp_path: Path) -> None:
    tgz = archive(tmp_path / "a.tgz", member("a"))
    content = bytearray(tgz.read_bytes())
    content[-8] ^= 1  # of the CRC
    tgz.write_bytes(content)
    with pytest.raises(DatasetError, match="CRC"):
        unpack(tgz, tmp_path / "out")


def test_a_page_in_place_of_an_archive_is_refused(tmp_path: Path) -> None:
    for name, content in (
        ("page", b"<html>log in</html>"),
        ("no tar", gzip.compress(b"page" * 99)),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(DatasetError, match="whole .tgz"):
            unpack(tmp_path / name, tmp_path / f"{name} out")
