import json
import re
import tomllib
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


@pytest.mark.parametrize(
    ("version", "requirement", "expected"),
    [
        ("2.0.0", "numpy>=2.0,<3", True),
        ("1.26.4", "numpy<3,>=2.0", False),
        ("3.0.0", "numpy<3,>=2.0", False),
        ("4.3", "gtsam>=4.3.0,<4.4", True),
        ("4.10.0.84", "opencv-contrib-python-headless>=4.11.0.86,<5", False),
        ("4.11.0.86", "opencv-contrib-python-headless>=4.11.0.86,<5", True),
        ("2.4.6+local.3", "numpy>=2.0,<3", True),
        ("10.1", "numpy", True),
    ],
)
def test_a_version_fits_where_it_lies_in_the_bounds(
    version: str, requirement: str, expected: bool
) -> None:
    assert doctor.fits(version, requirement) == expected


def test_a_version_that_vnav_cannot_use_is_named_with_what_it_needs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    versions = {"opencv-contrib-python-headless": "4.10.0.84"}
    monkeypatch.setattr(doctor.metadata, "version", versions.__getitem__)
    check = doctor.library("opencv-contrib-python-headless")
    assert not check.ok
    assert check.found.startswith("4.10.0.84, but vnav needs opencv-contrib-python-headless")
    assert ">=4.11.0.86" in check.mend


def test_every_library_that_vnav_needs_is_looked_at() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    needed = {re.split("[<>=]", requirement)[0] for requirement in project["dependencies"]}
    assert needed - set(doctor.SMALLER_BUILDS.values()) == set(doctor.OWNERS)


def test_the_exact_versions_of_the_checkout_lie_in_the_bounds() -> None:
    lines = (ROOT / "constraints.txt").read_text("utf-8").splitlines()
    exact = dict(line.split("==") for line in lines if not line.startswith("#"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    wanted = [*project["dependencies"], *project["optional-dependencies"]["test"]]
    known = {re.sub("[-_.]+", "-", name).lower(): version for name, version in exact.items()}
    for requirement in (line.partition(";")[0] for line in wanted):
        name = re.split("[<>=]", requirement)[0]
        if name != "open3d":  # of other platforms
            assert doctor.fits(known[name], requirement), requirement


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
