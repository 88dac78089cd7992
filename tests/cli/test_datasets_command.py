import io
import json
import tarfile
from pathlib import Path

import pytest

from vnav.cli.main import main

NAME = "rgbd_dataset_freiburg1_desk"


@pytest.fixture
def mirror(file_server) -> str:
    """Address of a server with one sequence of two files."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w:gz") as tar:
        for name in ("rgb.txt", "depth.txt"):
            info = tarfile.TarInfo(f"{NAME}/{name}")
            info.size = 4
            tar.addfile(info, io.BytesIO(b"1 a\n"))
    file_server.files[f"/freiburg1/{NAME}.tgz"] = buffer.getvalue()
    return file_server.url


def vnav(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr("sys.argv", ["vnav", "datasets", *map(str, arguments)])
    return main()


def test_fetch_verify_and_list_agree(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    mirror: str,
    tmp_path: Path,
) -> None:
    assert vnav(monkeypatch, "fetch", "fr1/desk", "--to", tmp_path, "--from", mirror) == 0
    assert capsys.readouterr().out == f"{tmp_path / NAME}  fetched\n"
    assert vnav(monkeypatch, "fetch", "fr1/desk", "--to", tmp_path, "--from", mirror) == 0
    assert "there already, and whole" in capsys.readouterr().out
    assert vnav(monkeypatch, "verify", "--in", tmp_path) == 0
    assert capsys.readouterr().out == f"{NAME}  2 files, whole\n"
    assert vnav(monkeypatch, "list", "fr1/desk*", "--in", tmp_path, "--json") == 0
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)}
    assert {name: row["state"] for name, row in rows.items()} == {NAME: "fetched", f"{NAME}2": ""}
    assert rows[NAME]["config"] == "tum_fr1"


def test_verify_tells_of_damage_and_exits_with_1(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    mirror: str,
    tmp_path: Path,
) -> None:
    vnav(monkeypatch, "fetch", NAME, "--to", tmp_path, "--from", mirror)
    capsys.readouterr()
    (tmp_path / NAME / "rgb.txt").write_text("cut")
    (tmp_path / NAME / "depth.txt").unlink()
    assert vnav(monkeypatch, "verify", "--in", tmp_path) == 1
    found = "1 missing (depth.txt); 1 damaged (rgb.txt) of 2 files"
    assert capsys.readouterr().out == f"{NAME}  {found}\n"
    assert vnav(monkeypatch, "verify", "--in", tmp_path, "--json") == 1
    (verdict,) = json.loads(capsys.readouterr().out)
    assert verdict == {"name": NAME, "files": 2, "missing": ["depth.txt"], "damaged": ["rgb.txt"]}


def test_verify_of_a_named_sequence_that_was_never_fetched_exits_with_1(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert vnav(monkeypatch, "verify", "fr1/desk", "--in", tmp_path) == 1
    assert capsys.readouterr().out == f"{NAME}  not fetched\n"


def test_the_list_shows_sizes_states_and_what_is_odd(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setenv("VNAV_DATASETS", str(tmp_path))
    (tmp_path / NAME).mkdir()
    assert vnav(monkeypatch, "list") == 0
    shown = capsys.readouterr().out.splitlines()
    (desk,) = [line for line in shown if f" {NAME} " in line]
    assert desk.split() == [NAME, "own", "copy", "344", "MB"]
    assert any("freiburg2_xyz_validation" in s and "no true trajectory" in s for s in shown)
    assert shown[-1] == f"kept in {tmp_path}"


def test_an_unreachable_server_exits_with_1_and_says_what_to_do(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    base = "http://127.0.0.1:1"
    assert vnav(monkeypatch, "fetch", "fr1/desk", "--to", tmp_path, "--from", base) == 1
    assert "is there a network?" in capsys.readouterr().err
