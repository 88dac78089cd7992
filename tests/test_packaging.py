"""A wheel, installed and run far from the checkout, is whole."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
SOURCES = ("vnav", "cli", "configs", "datasets", "pyproject.toml", "README.md", "LICENSE")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder into which the wheel of this checkout is installed; no network is needed."""
    source, wheels, site = (tmp_path_factory.mktemp(name) for name in ("source", "wheels", "site"))
    for name in SOURCES:
        path = ROOT / name
        copy = shutil.copytree if path.is_dir() else shutil.copy
        copy(path, source / name)
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    build = ["wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", wheels, source]
    subprocess.run([*pip, *build], check=True)
    (wheel,) = wheels.glob("vnav_rgbd-*.whl")
    subprocess.run([*pip, "install", "--no-deps", "--target", site, wheel], check=True)
    return site


def _run(site: Path, *command: str | Path) -> str:
    done = subprocess.run(
        [sys.executable, *command],
        env=os.environ | {"PYTHONPATH": str(site)},
        cwd=site.parent,
        text=True,
        capture_output=True,
        check=True,
    )
    return done.stdout


def test_the_installed_command_runs(site: Path) -> None:
    assert "vnav" in _run(site, site / "bin" / "vnav", "--version")


def test_the_installed_package_brings_its_presets_and_types(site: Path) -> None:
    code = "import vnav.config; print(vnav.__file__, *vnav.config.presets())"
    path, *presets = _run(site, "-c", code).split()
    assert Path(path).is_relative_to(site)
    assert presets == sorted(path.stem for path in (ROOT / "configs").glob("*.toml"))
    assert "patent" in presets
    assert (site / "vnav" / "py.typed").is_file()


def test_the_installed_package_draws_the_report(site: Path) -> None:
    code = "from vnav.reporting import view3d; print(len(view3d.style()), view3d.__file__)"
    length, path = _run(site, "-c", code).split()
    assert int(length) > 500
    assert Path(path).is_relative_to(site)
    assert {"ogl.min.js", "view.js"} <= {p.name for p in Path(path).parent.glob("web/*")}


def test_a_program_far_from_the_checkout_asks_a_map(
    site: Path, whole_map: Path, tiny_capture: Path
) -> None:
    code = (
        "import sys, vnav; flat = vnav.open_map(sys.argv[1]); answer = flat.locate(sys.argv[2]);"
        "path = flat.plan(start=answer, goal=sys.argv[3]);"
        "print(vnav.__file__, answer.located, path.found is not None, len(flat.landmarks()))"
    )
    photos = tiny_capture / "photos"
    path, located, found, landmarks = _run(
        site, "-c", code, whole_map, photos / "000.jpg", photos / "001.jpg"
    ).split()
    assert Path(path).is_relative_to(site)
    assert (located, found) == ("True", "True")
    assert int(landmarks) > 100


def test_the_installed_package_brings_its_public_sequences(site: Path) -> None:
    listed = _run(site, site / "bin" / "vnav", "datasets", "list")
    assert "rgbd_dataset_freiburg3_walking_xyz" in listed


def test_every_module_of_the_checkout_is_in_the_wheel(site: Path) -> None:
    expected = {p.relative_to(ROOT) for p in (ROOT / "vnav").rglob("*.py")}
    for folder in ("cli", "configs", "datasets"):
        files = (ROOT / folder).rglob("*.py")
        expected |= {Path("vnav") / p.relative_to(ROOT) for p in files}
    assert expected == {p.relative_to(site) for p in (site / "vnav").rglob("*.py")}
