import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from vnav import doctor
from vnav.cli.doctor import doctor as command

ROOT = Path(__file__).parent.parent


@pytest.fixture
def patients(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Modules whose self-tests pass, fail, crash and hang, where a child process finds them."""
    (tmp_path / "well.py").write_text("def self_test(): pass\n")
    (tmp_path / "ill.py").write_text("def self_test(): raise ValueError('expected 1, found 2')\n")
    crash = "import os, signal\ndef self_test(): os.kill(os.getpid(), signal.SIGSEGV)\n"
    (tmp_path / "crashing.py").write_text(crash)
    (tmp_path / "hanging.py").write_text("import time\ndef self_test(): time.sleep(60)\n")
    lacking = "raise ImportError('libusb-1.0.so.0: cannot open shared object file: No such file')"
    (tmp_path / "lacking.py").write_text(lacking)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))


@pytest.mark.usefixtures("patients")
@pytest.mark.parametrize(
    ("owner", "failure"),
    [
        ("well", ""),
        ("ill", "ValueError: expected 1, found 2"),
        ("crashing", "self-test of crashing died of SIGSEGV"),
        ("missing", "ModuleNotFoundError: No module named 'missing'"),
    ],
)
def test_a_self_test_tells_why_it_fails(owner: str, failure: str) -> None:
    assert doctor.self_test(owner) == failure


@pytest.mark.usefixtures("patients")
def test_a_self_test_that_hangs_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "PATIENCE_S", 0.5)
    assert "not done after" in doctor.self_test("hanging")


@pytest.mark.usefixtures("patients")
def test_a_missing_system_library_is_mended_by_its_package(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(doctor.OWNERS, "numpy", "lacking")
    check = doctor.library("numpy")
    assert not check.ok
    assert check.mend == "sudo apt-get install libusb-1.0-0"


def test_a_library_that_is_not_installed_is_named_with_the_way_to_install_it() -> None:
    check = doctor.library("no-such-library")
    assert (check.ok, check.found) == (False, "not installed")
    assert check.mend.endswith("-m pip install --force-reinstall 'no-such-library'")


def test_a_failed_self_test_asks_for_the_same_version_again() -> None:
    assert doctor.mend("ValueError: no", "gtsam==4.3.0").endswith("'gtsam==4.3.0'")


def test_the_makefile_installs_the_same_system_packages() -> None:
    lines = (ROOT / "Makefile").read_text().splitlines()
    listed = {
        name: set(line.partition(":=")[2].split())
        for line in lines
        for name in ("LIBRARIES", "PACKAGES")
        if line.startswith(f"{name} :=")
    }
    assert listed["LIBRARIES"] == set(doctor.SYSTEM_PACKAGES)
    assert listed["PACKAGES"] == set(doctor.SYSTEM_PACKAGES.values())


@pytest.mark.usefixtures("patients")
@pytest.mark.parametrize(("owner", "code"), [("well", 0), ("ill", 1)])
def test_the_command_exits_with_1_where_something_is_broken(
    owner: str, code: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "OWNERS", {"numpy": owner})
    shown = CliRunner().invoke(command, standalone_mode=False)
    assert shown.return_value == code
    assert ("expected 1, found 2" in shown.stdout) == bool(code)
    as_json = CliRunner().invoke(command, ["--json"], standalone_mode=False)
    report = json.loads(as_json.stdout)
    assert report["ok"] == (not code)
    assert [check["name"] for check in report["checks"]] == ["vnav", "machine", "cache", "numpy"]
